"""Small results of harness campaign, trace, identify and check, with names that no page may take for code."""

import json

import numpy as np

from harness.common.series import packed

NASTY = "\"><img src=x onerror='window.hit=1'><script>window.hit=1</script>"
TIME = np.arange(500) / 50
OUTPUT = {
    "measured yaw_rate": np.sin(TIME),
    "before yaw_rate": 0.7 * np.sin(TIME),
    "after yaw_rate": 0.99 * np.sin(TIME),
}
DRIVES = {
    "log1": {"time": TIME, **OUTPUT},
    f"log2 {NASTY}": {"time": TIME, **OUTPUT, "x": 10 * TIME, "y": TIME**2},
}
TRACE = {
    "verdict": "amended",
    "answer": f"The model lacks {NASTY}.",
    "held_out": [f"log2 {NASTY}"],
    "error": {"yaw_rate": {"unit": "rad/s", "before": 0.1, "after": 0.01}},
    "posterior": {
        "none_of_these": 0.1,
        "hypotheses": [{"name": "steering_lag", "kind": "effect", "probability": 0.9}],
        "models": [{"added": [[{"name": "steering_lag", "kind": "effect"}]], "probability": 0.9}],
    },
    "vehicle": {
        "bodies": {"": {"back": -2.0, "front": 2.0, "width": 1.5, "stated": False}},
        "axles": {"front": {"x": 1.2, "y": 0.0}, "rear": {"x": -1.3, "y": 0.0}},
        "coupling": None,
    },
    "pinpoint": [
        {"channel": name, "kind": kind, "ports": [name], "unit": "N", "log_likelihood_gain": gain,
         "log_likelihood_gain_after": 1.0, "ahead_of_first_cog": 1.2}
        for name, kind, gain in (("road_wheel_angle", "port", 900.0), ("yaw_rate", "sensor", 30.0))
    ],
    "rounds": [{"held_out_excess_by_output": {"yaw_rate": 170.0}, "added": "steering_lag", "reason": "best"}],
    "candidates": [
        {"round": 1, "name": "steering_lag", "kind": "effect", "bic_gain": 4000.0, "fitted": True,
         "held_out_excess": 0.4, "held_out_excess_by_output": {"yaw_rate": 0.3}},
        {"round": 1, "name": "mass", "kind": "parameter", "bic_gain": None, "fitted": False, "held_out_excess": None,
         "held_out_excess_by_output": None},
    ],
}  # fmt: skip
FIT = {
    "method": "likelihood", "model": "car+linear", "objective": {"name": "log-likelihood", "before": 1.0, "after": 2.0},
    "estimates": [
        {"name": n, "unit": "kg", "start": 2.0, "value": 3.0, "interval_95": [2.5, 3.5], "verdict": "determined"}
        for n in ("mass", NASTY)
    ],
    "correlation": [[1.0, -0.4], [-0.4, 1.0]], "notes": [],
}  # fmt: skip
CHECK = {
    "title": NASTY, "read": "2 signals", "answer": ["1 disagrees."], "warnings": [],
    "findings": [{"kind": "sign", "signals": ["yaw_rate"], "words": "the sign is wrong", "evidence": "slope -1"}],
    "comparisons": [{"signal": "yaw_rate", "name": "yaw rate from speed", "verdict": "disagrees", "reasons": ["sign"]}],
}  # fmt: skip
CAMPAIGN = {
    "title": f"Which estimator? {NASTY}",
    "findings": [
        {
            "finding": f"Few differ {NASTY}",
            "place": "5.2",
            "verdict": "reproduced",
            "ours": "1.2",
            "studies": ["study"],
        },
        {
            "finding": "Mass counts",
            "place": "5.3",
            "verdict": "not reproduced",
            "ours": "0.4 to 3",
            "studies": ["tyre"],
        },
    ],
}


def write_results(folder):
    """Write a campaign, a trace, a fit and a check below a folder."""
    (folder / "campaign").mkdir()
    (folder / "campaign" / "campaign.json").write_text(json.dumps(CAMPAIGN))
    gappy = np.where((TIME > 2) & (TIME < 3), np.nan, np.sin(TIME))
    series = {"recording": {"time": TIME, "speed": 5 + TIME, "yaw_rate": gappy},
              "comparison 0": {"time": TIME, "measured": gappy, "computed": -gappy}}  # fmt: skip
    for name, record, file, content in (
        ("trace", TRACE, "drives.npz", DRIVES),
        ("identify", FIT, "drives.npz", DRIVES),
        ("check", CHECK, "signals.npz", series),
    ):
        (folder / name).mkdir()
        (folder / name / f"{name}.json").write_text(json.dumps(record))
        (folder / name / file).write_bytes(packed(content))
