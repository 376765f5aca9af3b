"""Every file in models/drives keeps the contract, with its defaults and away from them."""

import types
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from harness.common.errors import ModelError
from harness.models.contracts import Profile
from harness.models.drive_options import kinds
from harness.models.drives._shapes import LIMIT
from harness.models.roles import DRIVES
from harness.simulation.drives import build_drive
from harness.testing import check_drive
from harness.testing.drives import CONTEXT

KINDS = DRIVES.names()


@pytest.fixture
def required(tmp_path: Path):
    """What each kind cannot do without: a recording, for those that need a file."""
    time = np.arange(0, 20, 0.01)
    columns = [time, 0.8 * np.sin(0.5 * time), 10 + np.sin(0.1 * time)]
    path = tmp_path / "recording.csv"
    np.savetxt(path, np.column_stack(columns), "%.9f", ",", header="time,steering_wheel_angle,speed")

    def of(kind: str) -> dict[str, object]:
        return {o.name: str(path) for o in kinds()[kind] if o.default is None}

    return of


@pytest.mark.parametrize("kind", KINDS)
def test_every_kind(kind, required):
    check_drive(kind, required(kind))


@pytest.mark.parametrize("kind", KINDS)
def test_the_limit_is_an_option_of_every_kind(kind):
    assert LIMIT.name in [o.name for o in kinds()[kind]]


@pytest.mark.parametrize("kind", [k for k in KINDS if k != "from_file"])
def test_does_not_depend_on_the_step(kind, required):
    fine, coarse = (build_drive(kind, required(kind), replace(CONTEXT, step=h)) for h in (0.01, 0.02))
    np.testing.assert_allclose(fine.steering_wheel_angle[::2], coarse.steering_wheel_angle, atol=1e-9)
    np.testing.assert_allclose(fine.speed[::2], coarse.speed, atol=1e-9)


@pytest.mark.parametrize("kind", [k for k in KINDS if "direction" in [o.name for o in kinds()[k]]])
def test_an_unknown_direction_is_refused(kind):
    with pytest.raises(ModelError, match="direction: 'up' is unknown"):
        build_drive(kind, {"direction": "up"}, CONTEXT)


@pytest.mark.parametrize("kind", [k for k in KINDS if "seed" in [o.name for o in kinds()[k]]])
def test_a_seed_is_a_whole_number(kind):
    with pytest.raises(ModelError, match=r"seed: 1\.5 is not a whole number"):
        build_drive(kind, {"seed": 1.5}, CONTEXT)


@pytest.mark.parametrize("kind", [k for k in KINDS if "duration" in [o.name for o in kinds()[k]]])
def test_the_drive_begins_after_its_lead_in(kind):
    assert not build_drive(kind, {"lead_in": "10 s"}, CONTEXT).steering_wheel_angle[:1000].any()
    with pytest.raises(ModelError, match=r"lead[-_]in"):
        build_drive(kind, {"duration": 5, "lead_in": 5}, CONTEXT)


# --- the check finds what it is for


def kind(steering=lambda t: np.radians(20) * np.sin(0.3 * t), speed=10.0) -> types.ModuleType:
    module = types.ModuleType("swing")
    module.__doc__, module.OPTIONS = "Swing.", ()

    def generate(options, context):
        time = np.arange(2000) * context.step
        return Profile(time, steering(time), np.full(len(time), speed))

    module.generate = generate
    return module


def test_a_right_drive_passes():
    check_drive(kind())


@pytest.mark.parametrize(
    ("wrong", "says"),
    [
        (kind(lambda t: np.zeros(len(t))), "does not steer"),
        (kind(lambda t: np.radians(20) * np.cos(t)), "must begin straight"),
        (kind(lambda t: np.radians(20) * (t > 5)), "faster than any driver"),
        (kind(lambda t: np.radians(20) * np.clip(t - 5, 0, 1)), "rate jumps"),
        (kind(lambda t: np.radians(20) * np.sin(0.3 * t) * np.random.default_rng().uniform(0.5, 1)), "every time"),
    ],
)
def test_a_wrong_drive_is_found(wrong, says):
    with pytest.raises(AssertionError, match=says):
        check_drive(wrong)
