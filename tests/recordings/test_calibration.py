"""Small causes that are known: which of three channels is late or misread, what is not told apart, what is mended."""

import re
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from harness.recordings.check.examine import examine
from harness.recordings.check.run import check_tables
from harness.recordings.motion.kinematics import local_polynomial
from harness.recordings.read.in_memory import tables_of
from harness.recordings.read.load import load_recording, recording_of

STEP = 0.01
TIME = np.arange(0, 120, STEP)
TRACTOR, TRAILER, ANGLE = "yaw_rate_tractor", "yaw_rate_trailer", "articulation_angle"


def truck(late=None, gain=None, wander=0.0017):
    """A truck that weaves: yaw rates that wander slowly, and the angle between; some channels late (s) or scaled."""
    rng = np.random.default_rng(5)
    frequency, phase = rng.uniform(0.05, 0.45, 12), rng.uniform(0, 6, 12)
    lag = 0.25 * np.arange(12) / 12 + 0.3

    def rates(time):
        waves = 2 * np.pi * frequency[:, None] * time
        tractor = 0.03 * np.sin(waves + phase[:, None]).sum(axis=0)
        return tractor, 0.03 * np.sin(waves + phase[:, None] - 2 * np.pi * (frequency * lag)[:, None]).sum(axis=0)

    fine = np.arange(-1, TIME[-1] + 1, 1e-3)
    turned = np.concatenate([[0], np.cumsum((rates(fine)[1] - rates(fine)[0])[:-1]) * 1e-3])
    late, gain = late or {}, gain or {}
    found = {
        TRACTOR: rates(TIME - late.get(TRACTOR, 0.0))[0],
        TRAILER: rates(TIME - late.get(TRAILER, 0.0))[1],
        ANGLE: np.interp(TIME - late.get(ANGLE, 0.0), fine, turned),
    }
    noise = {TRACTOR: np.radians(0.15), TRAILER: np.radians(0.15), ANGLE: np.radians(0.05)}
    found = {n: gain.get(n, 1.0) * v + rng.normal(0, noise[n], len(v)) for n, v in found.items()}
    found[TRACTOR] += wander * np.sin(0.06 * TIME + 1)
    found[TRAILER] += wander * np.cos(0.045 * TIME)
    return pd.DataFrame({"time": TIME, **found})


def examined(table):
    return examine(recording_of(tables_of(table, mapped=False), "truck"))


@pytest.mark.parametrize("name", [TRACTOR, TRAILER, ANGLE])
def test_which_of_three_channels_is_late_is_told(name):
    found = examined(truck(late={name: 0.03}))
    assert [(f.kind, f.signals) for f in found.findings] == [("delay", (name,))], found.findings
    assert found.causes[0].value == pytest.approx(0.03, abs=0.004)
    assert abs(found.causes[0].value - 0.03) < 3.5 * found.causes[0].std


@pytest.mark.parametrize("name", [TRACTOR, TRAILER, ANGLE])
def test_which_of_three_channels_is_misread_is_told(name):
    found = examined(truck(gain={name: 0.9}))
    assert [(f.kind, f.signals) for f in found.findings] == [("scale", (name,))], found.findings
    assert found.causes[0].value == pytest.approx(-0.1, abs=0.015)


def test_a_signal_and_its_derivatives_are_smoothed_alike():
    """A sine of 0.7 Hz over 1.2 s: the polynomial's own slope and value of it are 7 % apart, its curvature 48 %."""
    pace, inside = 2 * np.pi * 0.7, slice(100, -100)
    wave, rate, curve = np.sin(pace * TIME), pace * np.cos(pace * TIME), -(pace**2) * np.sin(pace * TIME)
    own = [local_polynomial(rate, STEP, 1.2)[inside], local_polynomial(wave, STEP, 1.2, 1)[inside]]
    assert own[1].std() / own[0].std() == pytest.approx(1.066, abs=0.005)
    for highest, sides in ((1, (rate, wave)), (2, (curve, rate, wave))):
        found = [local_polynomial(side, STEP, 1.2, n, highest)[inside] for n, side in enumerate(sides)]
        for other in found[1:]:
            np.testing.assert_allclose(other, found[0], atol=1e-3 * found[0].std())


def test_delay_and_scale_of_one_channel_do_not_bias_each_other():
    found = examined(truck(late={TRAILER: 0.05}, gain={TRAILER: 1.12}))
    assert {(c.kind, c.signals) for c in found.causes} == {("delay", (TRAILER,)), ("scale", (TRAILER,))}
    by = {c.kind: c.value for c in found.causes}
    assert by["delay"] == pytest.approx(0.05, abs=0.006)
    assert by["scale"] == pytest.approx(0.12, abs=0.02)


def test_what_is_late_is_named_before_what_would_be_early():
    """A late angle, or two early yaw rates: kinematics does not say which, but no reading comes before the event."""
    found = examined(truck(late={TRACTOR: 0.01, TRAILER: 0.012, ANGLE: 0.021}))
    assert [(f.kind, f.signals) for f in found.findings] == [("delay", (ANGLE,))], found.findings
    assert re.fullmatch(r"articulation_angle: (9|10|11)\.\d ± [01]\.\d ms late", found.findings[0].words)


def test_wandering_yaw_rates_are_no_finding():
    assert examined(truck(late={TRACTOR: 0.002, ANGLE: 0.001}, gain={TRAILER: 1.005})).findings == ()


def test_only_lines_that_help_are_written():
    found = check_tables(tables_of(truck(late={ANGLE: 0.02}), mapped=False), "truck")
    assert [line.split(" = ")[0] for line in found.remedy.lines] == [ANGLE]
    assert re.search(r'delay = "(19|20|21)\.\d* ms"', found.remedy.lines[0]), found.remedy.lines
    assert found.remedy.passes


LAP = Path(__file__).parents[3] / "shared" / "measured" / "genesis_g80" / "med_lap_center_8_21.mat"


@pytest.mark.skipif(not LAP.is_file(), reason=f"the measured drives are no part of the project; put one into {LAP}")
def test_a_comparison_that_is_left_without_channels_says_nothing():
    """What rounding left of them had a covariance that could not be inverted."""
    found = examine(load_recording(LAP, Path(__file__).parents[2] / "studies" / "channels" / "genesis_g80.toml"))
    assert ("offset", ("lateral_acceleration",)) in [(f.kind, f.signals) for f in found.findings]
    assert all(0 < c.std < 1 for c in found.causes)
