"""A particle filter over an FMU for co-simulation, against the Kalman filter of the same linear equations."""

from dataclasses import replace

import numpy as np
import pytest

from harness.common.errors import UserError
from harness.common.files import toml_text
from harness.external.fmu import belief
from support import fmus

pytestmark = fmus.needs_compiler

STEP, Q, R = 0.01, 4.0, 1e-4
"""Sample time in s, variance of the force in N^2 per sample, and of the measured angle in rad^2."""


@pytest.fixture(scope="module", params=[2, 3])
def spring(request, tmp_path_factory):
    folder = tmp_path_factory.mktemp("spring")
    flag = "canGetAndSetFMUstate" if request.param == 2 else "canGetAndSetFMUState"
    path = fmus.make(folder, replace(fmus.SPRING, interface_attributes=f'{flag}="true"'), request.param)
    (folder / "spring.toml").write_text(toml_text(fmus.SPRING_MAP))
    return path


@pytest.fixture(scope="module")
def drive():
    """Steering in rad and a noisy sideslip angle of the mass on its spring, some of it missing."""
    rng, x = np.random.default_rng(2), np.array([0.0, 0.1])
    A, b = np.array([[1.0, STEP], [-2.5 * STEP, 1.0]]), STEP / 2.0
    angle = 0.02 * np.sin(0.05 * np.arange(300))
    measured = []
    for steer in angle:
        measured.append(x[0] + 0.1 * np.degrees(steer) + rng.normal(0.0, R**0.5))
        x = A @ x + [0.0, b * (np.degrees(steer) + rng.normal(0.0, Q**0.5))]
    measured = np.array(measured)[:, None]
    measured[rng.random(300) < 0.1] = np.nan
    measured[0] = np.nan
    return angle[:, None], measured


def kalman(drive):
    """Return the mean of the velocity (heading here), its variance, and those of the angle."""
    A, G = np.array([[1.0, STEP], [-2.5 * STEP, 1.0]]), np.array([0.0, STEP / 2.0])
    x, P, rows = np.array([0.0, 0.1]), np.zeros((2, 2)), []
    for k, (steer, y) in enumerate(zip(np.degrees(drive[0][:, 0]), drive[1][:, 0], strict=True)):
        if k:
            x, P = A @ x + G * np.degrees(drive[0][k - 1, 0]), A @ P @ A.T + Q * np.outer(G, G)
        if not np.isnan(y):
            S = P[0, 0] + R
            K = P[:, 0] / S
            x, P = x + K * (y - x[0] - 0.1 * steer), P - np.outer(K, K) * S
        rows.append([x[1], P[1, 1]])
    mean, variance = np.array(rows).T
    return np.radians(mean), variance * np.radians(1.0) ** 2


def loader(spring, **settings):
    return {
        "file": str(spring),
        "filter": "particle",
        "measurements": ["sideslip_angle"],
        "estimates": ["heading"],
        "values": ["mass", "measurement_noise.sideslip_angle", "seed"],
        "settings": {"map": str(spring.parent / "spring.toml"), "process_noise": {"side_force": Q}, **settings},
    }


def run(spring, drive, particles, seed=3, mass=2.0):
    body = belief.load(loader(spring, particles=particles))
    return body.estimate(STEP, *drive, np.array([mass, R, 0.0]), seed)


def test_many_particles_come_near_to_the_kalman_filter(spring, drive):
    mean, variance = kalman(drive)
    share = {}
    for particles in (100, 1600):
        got = run(spring, drive, particles)
        assert (got.reached, got.reason) == (300, "")
        share[particles] = (np.abs(got.estimates[:, 0] - mean)[50:] / np.sqrt(variance[50:])).mean()
        assert 0.7 < (got.variances[50:, 0] / variance[50:]).mean() < 1.3
    assert share[1600] < 0.2
    assert share[1600] < 0.6 * share[100]


def test_runs_are_the_same_again_and_depend_on_seed_and_parameters(spring, drive):
    body = belief.load(loader(spring, particles=50))
    values = np.array([2.0, R, 0.0])
    first, _, again = (body.estimate(STEP, *drive, values, seed) for seed in (3, 4, 3))
    assert again.estimates.tobytes() == first.estimates.tobytes()
    assert body.estimate(STEP, *drive, values, 4).estimates.tobytes() != first.estimates.tobytes()
    assert np.abs(run(spring, drive, 50, mass=2.9).estimates - first.estimates).max() > 1e-4


@pytest.mark.parametrize(
    ("settings", "words"),
    [
        ({"process_noise": {"wind": 1.0}}, r"the map's \[process_noise\] has side_force"),
        ({"alpha": 1.0}, "unknown key 'alpha'"),
    ],
)
def test_settings_that_do_not_fit_are_refused(spring, settings, words):
    with pytest.raises(UserError, match=words):
        belief.load(loader(spring, **settings))


def test_an_fmu_without_states_to_set_is_refused(tmp_path):
    path = fmus.make(tmp_path, fmus.SPRING)
    (tmp_path / "spring.toml").write_text(toml_text(fmus.SPRING_MAP))
    with pytest.raises(UserError, match="cannot be got and set"):
        belief.load(loader(path))
