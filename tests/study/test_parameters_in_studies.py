"""Unknown and considered parameters in studies: they are scored, and the states gain by them."""

import numpy as np
import pytest

from harness.common.errors import UserError
from harness.config import build_study
from harness.study.design import units
from harness.study.evaluate import StudyEvaluator

MASS = {"name": "trailer_mass", "prior": "12 t"}


def study(belief, score_after="10 s"):
    content = {
        "name": "mine",
        "targets": ["lateral_force_axle_21"],
        "score_after": score_after,
        "drive": [{"name": "sine", "kind": "sine", "duration": "20 s", "speed": "15 m/s", "amplitude": "50 deg"}],
        "plant": {
            "vehicle": "semitrailer",
            "parameters": "ziaukas_2023",
            "tyre": "magic_formula",
            "sensors": "stability_control",
        },
        "belief": {"values": {"trailer_mass": "24 t"}, **belief},
        "estimator": [{"name": "EKF", "kind": "ekf"}],
        "design": [{"name": "level", "factor": [{"parameter": "trailer_mass", "levels": ["14 t"]}]}],
    }
    return build_study(content, "mine.toml")


def scores(of):
    (unit,) = units(of, of.designs[0])
    found = StudyEvaluator(of).evaluate(unit)
    return {name: found[name][0, 0, 0] for name in ("rmse", "nees", "status")}


def test_an_estimated_mass_takes_the_error_away():
    wrong, found = scores(study({})), scores(study({"unknown_parameters": [MASS]}))
    assert found["rmse"][0] < 0.2 * wrong["rmse"][0]
    assert found["rmse"][1] < 1000.0  # kg, of ten tonnes at first
    assert found["nees"] < 3 * 11 < wrong["nees"]
    assert found["status"] == 0


def test_a_considered_mass_widens_the_band():
    wrong, considered = scores(study({})), scores(study({"considered_parameters": [MASS]}))
    assert considered["nees"] < 0.05 * wrong["nees"]
    assert np.isfinite(considered["nees"])


def test_scores_that_never_begin_are_refused():
    with pytest.raises(UserError, match="leaves nothing of drive 'sine'"):
        StudyEvaluator(study({}, score_after="20 s"))
