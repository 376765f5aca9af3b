"""How a level is said: by its value, or by how far it is from what is believed."""

from copy import deepcopy
from dataclasses import replace

import pytest

from harness.config import build_study
from harness.study.evaluate import StudyEvaluator
from harness.study.report.levels import phrase
from harness.study.results import read
from harness.study.store import Store

PERCENT = ["-30 %", "0 %", "+15 %"]
DESIGNS = {
    "tyres": [("stiffness_peak_front", {"shift": PERCENT}), ("stiffness_peak_rear", {"shift": PERCENT})],
    "mass": [("mass", {"shift": ["-200 kg", "0 kg", "0.3 t"]})],
    "belief": [("yaw_inertia", {"shift": PERCENT, "of": "belief"})],
    "apart": [("mass", {"shift": ["0 %", "10 %"]}), ("friction", {"shift": ["0 %", "-20 %"]})],
    "within": [("friction", {"bands": ["0 %", "10 %", "20 %"]})],
    "banded": [("mass", {"shift": ["0 %", "10 %"], "band": "5 %"})],
    "value": [("mass", {"levels": ["1.5 t", "1.8 t"]})],
}


@pytest.fixture(scope="module")
def designs(tmp_path_factory):
    """The designs of a store in which no run is done yet, by name."""
    content = {
        "name": "levels",
        "targets": ["yaw_rate"],
        "plant": {"vehicle": "car", "parameters": "govindarajan_2018", "tyre": "linear", "sensors": "car_series"},
        "drive": [{"name": "sine", "kind": "sine", "duration": "5 s", "amplitude": "20 deg"}],
        "estimator": [{"kind": "ekf"}],
        "design": [
            {
                "name": name,
                "samples": 2 if name in ("within", "banded") else 1,
                "factor": [{"parameter": parameter, **stated} for parameter, stated in factors],
            }
            for name, factors in DESIGNS.items()
        ],
    }
    study = build_study(content)
    folder = tmp_path_factory.mktemp("levels")
    Store(study, lambda: StudyEvaluator(study), folder)
    return {d.name: d for d in read(folder).designs}


@pytest.mark.parametrize(
    ("design", "band", "home", "expected"),
    [
        ("tyres", 0, 1, "with the stiffness peak front and stiffness peak rear 30 % softer than believed"),
        ("tyres", 2, None, "with the stiffness peak front and stiffness peak rear 15 % stiffer than believed"),
        ("mass", 2, 1, "with the mass 300 kg heavier than believed"),
        ("mass", 1, 0, "with the mass as believed instead of 200 kg lighter"),
        ("belief", 0, 2, "with the yaw inertia believed to be 30 % smaller than stated instead of 15 % larger"),
        ("apart", 1, 0, "with the mass 10 % heavier and the friction 20 % smaller than believed"),
        ("within", 2, 0, "with the friction within ±20 % of what is believed"),
        ("within", 2, 1, "with the friction within ±20 % of what is believed instead of ±10 %"),
        ("banded", 1, 0, "with the mass 10 % heavier (±5 %) than believed instead of ±5 %"),
        ("value", 1, 0, "with the mass at 1.8 t instead of 1.5 t"),
    ],
)
def test_a_level_is_said_as_the_study_states_it(designs, design, band, home, expected):
    assert phrase(designs[design], band, home) == expected


def test_what_the_estimators_know_nothing_of_is_not_believed(designs):
    design = deepcopy(designs["mass"])
    design.factors[0] = replace(design.factors[0], is_believed=False)
    assert phrase(design, 2, 1) == "with the mass 300 kg heavier than stated"
    assert phrase(design, 1, 0) == "with the mass as stated instead of 200 kg lighter"
    assert design.matched_is == "as stated"


def test_a_level_that_looks_like_a_difference_is_none(designs):
    """Masses at the labels of differences that they do not have are said by these labels."""
    design = deepcopy(designs["mass"])
    design.factors[0].lower[0] = design.factors[0].upper[0] = 1.0
    assert phrase(design, 0) == "with the mass at -200 kg"
