"""The lines that mend a channel map, and the trial of each by a fit of the nominal model."""

from dataclasses import replace

import numpy as np
import pytest

import harness as h
from harness.identification.fit_recordings import NominalFit
from harness.recordings.check.causes import DELAY, HEADING, SIGN, RecordingFault
from harness.recordings.check.examine import Finding, examine
from harness.recordings.check.remedy import mended, spoils
from harness.recordings.check.run import MapRemedy, check_tables, tried_by_fit
from harness.recordings.read.in_memory import tables_of
from harness.recordings.read.load import recording_of


@pytest.mark.parametrize(
    ("entry", "after"),
    [
        ({}, {"sign": -1}),
        ({"sign": -1}, {}),
        ({"factor": -1.0}, {}),
        ({"factor": -2.0}, {"factor": 2.0}),
        ({"factor": 2.0}, {"factor": 2.0, "sign": -1}),
    ],
)
def test_a_sign_is_turned_where_the_map_has_it(entry, after):
    named = {"channel": "r", "unit": "rad/s"}
    fault = RecordingFault(SIGN, ("yaw_rate",), -1.0, 0.0, 0.0, "wrong sign")
    found = mended({"yaw_rate": {**named, **entry}}, [fault], [], {}, 60.0)
    assert found == {"yaw_rate": {**named, **after}}


def test_a_heading_that_is_none_of_a_compass_loses_the_convention():
    entry = {"channel": "h", "unit": "deg", "convention": "compass"}
    fault = RecordingFault(HEADING, ("heading",), -1.0, np.pi / 2, 0.0, "a compass heading")
    assert mended({"heading": entry}, [fault], [], {}, 60.0) == {"heading": {"channel": "h", "unit": "deg"}}
    rear = RecordingFault(HEADING, ("heading",), 1.0, np.pi, 0.0, "that of the rear")
    turned = mended({"heading": entry}, [rear], [], {}, 60.0)["heading"]
    assert turned == {"channel": "h", "unit": "deg", "sign": -1, "offset": "270 deg"}


@pytest.fixture(scope="module")
def car():
    """A car's drive, its map, and what a check of it says: nothing."""
    model = h.model("car", "govindarajan_2018", sensors="car_series")
    run = h.simulate(model, h.drive("sine", duration="60 s", amplitude="30 deg", frequency="0.3 Hz"), seed=4)
    tables = tables_of(run[["steering_wheel_angle", "speed", "yaw_rate", "lateral_acceleration"]], mapped=True)
    units = {"steering_wheel_angle": "rad", "speed": "m/s", "yaw_rate": "rad/s", "lateral_acceleration": "m/s^2"}
    content = {"time": [{"channel": "time", "unit": "s"}]}
    content |= {name: {"channel": name, "unit": unit} for name, unit in units.items()}
    findings = check_tables(tables, "car", content)
    assert not findings.findings

    def examined(by):
        recording = recording_of(tables, "car", by)
        return recording, examine(recording), frozenset()

    return content, findings, examined


def offered(car, **delays):
    """Return the findings of a check that takes signals for late, and offers lines for it."""
    content, findings, _ = car
    lines = {name: {**content[name], "delay": delay} for name, delay in delays.items()}
    found = tuple(Finding(DELAY, (name,), f"{name}: late", "") for name in delays)
    remedy = MapRemedy({**content, **lines}, tuple(lines), findings.fits)
    return replace(findings, findings=found, remedy=remedy)


def test_lines_that_spoil_the_fit_of_the_nominal_model_are_withdrawn(car):
    content, _, examined = car
    tried = tried_by_fit(
        offered(car, yaw_rate="200 ms", speed="1 ms"), content, examined, NominalFit("govindarajan_2018")
    )
    rate, speed = tried.findings
    assert not rate.mends
    assert "not mended: the error of the fitted nominal model would be" in rate.words
    assert speed.mends, "a delay of the speed changes nothing"
    assert tried.remedy.content == {**content, "speed": {**content["speed"], "delay": "1 ms"}}
    assert len(tried.remedy.lines) == 1
    alone = tried_by_fit(offered(car, yaw_rate="200 ms"), content, examined, NominalFit("govindarajan_2018"))
    assert alone.remedy is None


def test_lines_that_the_fit_needs_stay(car):
    content, findings, examined = car
    late = {**content, "yaw_rate": {**content["yaw_rate"], "delay": "-200 ms"}}
    remedy = MapRemedy(content, ("yaw_rate",), findings.fits)
    offer = replace(findings, findings=(Finding(DELAY, ("yaw_rate",), "yaw_rate: late", ""),), remedy=remedy)
    tried = tried_by_fit(offer, late, examined, NominalFit("govindarajan_2018"))
    assert tried.findings[0].mends
    assert tried.remedy.content == content


def test_a_map_that_cannot_be_tried_is_offered_with_a_warning(car):
    content, _, examined = car
    offer = offered(car, yaw_rate="200 ms")
    tried = tried_by_fit(offer, content, examined, NominalFit("ziaukas_2023"))
    assert tried.remedy == offer.remedy
    assert any("was not tried by a fit of the nominal model" in w for w in tried.warnings)


def test_only_an_error_that_grows_for_sure_spoils():
    rng = np.random.default_rng(0)
    without = rng.gamma(2.0, 0.01, 40)
    assert not spoils(without, without)
    assert not spoils(without * rng.lognormal(0.0, 0.3, 40), without)
    assert not spoils(without * 1.03, without), "surely more, and too little to matter"
    assert spoils(without * 1.2, without)
    assert spoils(np.full(40, np.inf), without)
