"""Study of the models that a trace leaves open, from a confusable set that is stated here."""

import json
import math
from dataclasses import replace
from types import SimpleNamespace

import pytest

from harness.config import load_study
from harness.config.parameter_set import set_text
from harness.diagnosis.result.mixture import mixture_of, study_of
from support.driven_car import driven


def model(share, *added, **estimates):
    """Return a model of the set as ``trace.json`` has it; estimates are values with their errors."""
    rows = [{"name": n, "value": v, "standard_error": e} for n, (v, e) in estimates.items()]
    table = [[float(i == j) for j in range(len(rows))] for i in range(len(rows))]
    names = [[{"name": name, "kind": kind}] for name, kind in added]
    return {"added": names, "share": share, "estimates": rows, "correlation": table}


LAG = model(0.7, ("steering_lag", "effect"), steering_lag=(0.1, 0.01), mass=(1700.0, 9.0))
GUST = model(0.2, ("crosswind", "effect"), ("yaw_inertia", "parameter"), crosswind_force=(400.0, 20.0),
             yaw_inertia=(3000.0, 50.0))  # fmt: skip
NOTHING = model(0.06, mass=(1650.0, 5.0))


@pytest.fixture
def outcome(augmented):
    """What a trace that added the lag leaves; the nominal mass is what the set states."""
    drives = [augmented.drive(driven(5, ["steering_lag"], 5.0, steering_lag=0.1), "drive")]
    spec = augmented.spec
    amended = replace(spec, effects=("steering_lag",), values={**spec.values, "steering_lag": 0.1, "mass": 1700.0})
    fitting = SimpleNamespace(augmented=augmented, drives=drives)
    return SimpleNamespace(refused=None, amended=amended, verdict="amended", estimates=[("mass", 1700.0, 9.0)],
                           trace=SimpleNamespace(fitting=fitting))  # fmt: skip


def test_the_plant_can_be_any_of_the_models_and_is_none_unless_drawn(outcome, tmp_path):
    set_ = {"models": [LAG, GUST, NOTHING]}
    (text,) = study_of(outcome, "amended.toml", set_).values()
    content = {"confusable": set_, "estimates": [], "correlation": []}
    (tmp_path / "trace.json").write_text(json.dumps(content))
    (tmp_path / "amended.toml").write_text(set_text(outcome.amended, "test", {}))
    (tmp_path / "posterior.toml").write_text(text)
    study = load_study(tmp_path / "posterior.toml")
    stated, plant = outcome.trace.fitting.augmented.spec.values, study.plant
    assert set(plant.effects) == {"steering_lag", "crosswind"}
    assert (plant.values["steering_lag"], plant.values["crosswind_force"]) == (0.0, 0.0)
    assert (plant.values["mass"], plant.values["yaw_inertia"]) == pytest.approx((stated["mass"], stated["yaw_inertia"]))
    assert study.belief.effects == ("steering_lag",)
    assert (study.belief.values["steering_lag"], study.belief.values["mass"]) == pytest.approx((0.1, 1700.0))
    assert [(d.name, d.share) for d in study.designs[:3]] == [
        ("steering_lag", 0.7), ("crosswind-and-yaw_inertia", 0.2), ("nothing-added", 0.06),
    ]  # fmt: skip
    for design, each in zip(study.designs, set_["models"], strict=False):
        drawn = [(e["name"], e["value"], e["standard_error"]) for e in each["estimates"]]
        assert [(f.parameter, *f.marginal.arguments[:2]) for f in design.factors] == drawn


def test_a_model_of_which_no_error_is_known_is_named_and_not_drawn(outcome):
    unknown = model(0.3, ("yaw_inertia", "parameter"), yaw_inertia=(3000.0, math.inf))
    mixture = mixture_of(outcome, {"models": [LAG, unknown, NOTHING, GUST, model(0.01, mass=(1.0, 1.0))]})
    assert [number for _, number, _ in mixture.models] == [1, 3, 4]
    assert mixture.left_out == ("yaw_inertia (0.3)", "nothing-added (0.01)")
    assert mixture_of(outcome, {"models": [LAG, unknown]}) is None
    assert mixture_of(outcome, None) is None
    (text,) = study_of(outcome, "amended.toml", {"models": [LAG, unknown, NOTHING]}).values()
    assert "# Not drawn, as their shares are small or the error of a parameter is not known: yaw_inertia (0.3)." in text


def test_designs_are_called_by_what_the_models_differ_in(outcome):
    """What all have is no part of a name; a name that is too long for one is a number."""
    both, rest = LAG | {"added": [*LAG["added"], *GUST["added"]]}, LAG | {"share": 0.1}
    mixture = mixture_of(outcome, {"models": [both, rest]})
    assert [name for name, _, _ in mixture.models] == ["crosswind-and-yaw_inertia", "nothing-more"]
    several = [[{"name": f"stiffness_peak_{k}", "kind": "parameter"}] for k in range(9)]
    mixture = mixture_of(outcome, {"models": [NOTHING, GUST | {"added": several}]})
    assert [name for name, _, _ in mixture.models] == ["nothing-added", "model-2"]
