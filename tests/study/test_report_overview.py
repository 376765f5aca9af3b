"""Studies whose designs vary one factor each open with a map of all levels."""

import copy

import numpy as np
import pytest

from harness.config import build_study
from harness.study.report import analyse
from harness.study.report.sections import boxes, overview
from harness.study.run import run_study

STUDY = {
    "name": "degraded",
    "seed": 3,
    "targets": ["lateral_velocity", "yaw_rate"],
    "plant": {
        "vehicle": "car", "parameters": "govindarajan_2018", "tyre": "linear", "sensors": "car_series",
        "effects": ["dropout", "latency"],
    },
    "drive": [{"name": "sine", "kind": "sine", "duration": "5 s", "speed": "15 m/s", "amplitude": "20 deg"}],
    "estimator": [{"name": "EKF", "kind": "ekf"}, {"name": "UKF", "kind": "ukf"}],
    "design": [
        {"name": "share", "repeats": 3, "factor": [{"parameter": "dropout_share", "levels": ["0 %", "50 %", "90 %"]}]},
        {"name": "delay", "repeats": 3, "factor": [{"parameter": "latency_delay", "levels": ["0 s", "0.1 s"]}]},
    ],
}  # fmt: skip


@pytest.fixture
def of(tmp_path):
    """Return what analyses a study with some of the designs."""

    def analysis(designs):
        run_study(build_study(copy.deepcopy(STUDY) | {"design": designs}), tmp_path)
        return analyse(tmp_path)

    return analysis


def test_several_designs_of_one_factor_each_are_one_map(of):
    analysis = of(STUDY["design"])
    assert [f.design.name for f in analysis.one_factor_each] == ["share", "delay"]
    (picture,) = overview.pictures(analysis)
    assert "lateral velocity and yaw rate" in picture.caption
    assert "further designs" not in picture.caption
    assert analysis.findings[0].design.bands == ["0 %", "50 %", "90 %"]
    for findings in analysis.findings:
        assert np.isfinite(findings.medians).all()
        assert (findings.medians[:, -1] > findings.medians[:, 0]).all()  # readings that are missing or late cost
    assert sum(hasattr(block, "svg") for block in boxes.blocks(analysis)) == 2


def test_designs_of_several_factors_are_named_beside_the_map(of):
    both = [{"parameter": "dropout_share", "levels": [0.0, 0.5]}, {"parameter": "latency_delay", "levels": [0.0, 0.1]}]
    (picture,) = overview.pictures(of([*STUDY["design"], {"name": "all-at-once", "repeats": 1, "factor": both}]))
    assert "further designs, all-at-once, " in picture.caption


def test_one_design_and_designs_of_the_same_factor_are_not(of):
    analysis = of(STUDY["design"][:1])
    assert overview.pictures(analysis) == []
    assert sum(hasattr(block, "svg") for block in boxes.blocks(analysis)) == 0  # the answer has it
