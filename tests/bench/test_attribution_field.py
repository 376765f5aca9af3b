"""Field quality in the proof: a fault of the recording that is named is no claim about the vehicle; own tables."""

import json

import numpy as np
import pytest

from bench.attribution import renew
from bench.attribution.renew import MARKS
from bench.attribution.run import QUALITIES, Case, task_of, written
from bench.attribution.score import score, text

LATE = {"name": "sensor_delay", "place": "yaw_rate_tractor", "delay": 0.03}
DRIFT = {"name": "sensor_bias", "place": "yaw_rate_trailer", "largest": 0.002}


def scored(folder, verdict, added, kind="none", effects=(), recording=(LATE, DRIFT)):
    """Score a trace of a recording that has faults."""
    expected = {"none": "adequate", "effect": "amended"}[kind]
    seal = {"case": f"semitrailer-{kind}", "repeat": 0, "vehicle": "semitrailer", "kind": kind}
    seal |= {"expected_verdict": expected, "effects": list(effects), "parameters": {}, "noise": {"yaw_rate_tractor": 1}}
    seal |= {"quality": "field", "recording": list(recording)}
    found = [{"effect": name, "place": place, "parameters": {}} for name, place in added]
    traced = {"verdict": verdict, "added": found, "parameters": [], "confusable": None, "candidates": []}
    traced |= {"excess": {"before": 4.0, "after": 1.0}}
    (folder / "trace").mkdir(parents=True, exist_ok=True)
    (folder / "sealed.json").write_text(json.dumps(seal))
    (folder / "trace" / "trace.json").write_text(json.dumps(traced))
    return score(folder)


def test_a_fault_of_the_recording_that_is_there_is_no_false_alarm(tmp_path):
    found = scored(tmp_path, "amended", [("sensor_delay", "yaw_rate_tractor"), ("sensor_bias", "yaw_rate_trailer")])
    assert found.right
    assert found.verdict == found.expected == "adequate"
    assert found.recording == ("sensor_delay", "sensor_bias")
    assert (found.claimed, found.extra, found.quality) == ((), (), "field")


@pytest.mark.parametrize(
    "added",
    [
        [("sensor_delay", "lateral_acceleration_tractor")],  # that channel is not late
        [("sensor_delay", "yaw_rate_tractor"), ("steering_lag", None)],
    ],
)
def test_a_fault_that_is_not_there_and_an_effect_are_false_alarms(tmp_path, added):
    found = scored(tmp_path, "amended", added)
    assert not found.right
    assert found.extra == (added[-1][0],)


def test_a_planted_fault_of_a_sensor_stays_a_claim(tmp_path):
    planted = {
        "name": "sensor_delay",
        "equivalent": [],
        "place": "yaw_rate_tractor",
        "parameters": {"sensor_delay_yaw_rate_tractor": {"value": 0.07, "unit": "s"}},
        "oracle": {"form": "same", "parameters": {"sensor_delay_yaw_rate_tractor": 0.07}, "per_drive": {}},
    }
    found = scored(tmp_path, "amended", [("sensor_delay", "yaw_rate_tractor")], "effect", [planted])
    assert found.right
    assert (found.claimed, found.recording) == (("sensor_delay",), ())


def test_the_page_holds_the_tables_of_both_qualities(tmp_path, monkeypatch):
    results, page = tmp_path / "attribution.json", tmp_path / "page.md"
    results.write_text(text([scored(tmp_path / "case", "adequate", [])]))
    page.write_text("\n".join(["Why.", *MARKS["clean"], *MARKS["field"], ""]))
    monkeypatch.setattr(renew, "PAGE", page)
    assert not renew.main([str(results)])
    before, _, after = page.read_text().partition(MARKS["field"][0])
    assert "| none |" not in before
    assert "| none | 1 of 1, 100 %" in after
    assert "\n#### By kind" in after


@pytest.mark.parametrize("quality", [q for q in QUALITIES[1:] if q != "real"])
def test_what_the_plant_writes_is_what_the_tracer_reads(tmp_path, quality):
    assert not written(Case("car-none", 0, tmp_path, quality))
    task, vehicle = task_of(tmp_path)
    assert vehicle == "car"
    drive = task.train[0]
    assert float(drive["time"][1]) == pytest.approx(0.01)
    assert drive.sizes["time"] == pytest.approx(12000, abs=6)
    assert all(np.isfinite(drive[name]).all() and not drive[name].attrs["gaps"] for name in drive)
    assert float(np.abs(drive["yaw_rate"]).max()) < 1.0  # outliers are missing samples
    assert not any("spikes" in w and "kept" in w for w in drive.attrs["warnings"])
