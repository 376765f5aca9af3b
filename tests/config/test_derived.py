"""Cornering stiffness and understeer gradient in place of the parameters that follow from them."""

import numpy as np
import pytest

from harness.common.errors import UserError
from harness.config import build_study
from harness.config.derived import GRADIENT, axle_values, derived_parameters, settled
from harness.config.model import resolve_single
from harness.models.parameters import govindarajan_2018 as genesis

CASES = [
    ("car", "magic_formula", "govindarajan_2018", "car_series"),
    ("car", "brush", "govindarajan_2018", "car_series"),
    ("car", "magic_formula_61", "pacejka_2006", "car_series"),
    ("car_two_track", "magic_formula", "althoff_2020", "car_series"),
    ("semitrailer", "magic_formula", "ziaukas_2023", "series"),
]


def spec(vehicle, tyre, parameters, sensors):
    return resolve_single({"vehicle": vehicle, "parameters": parameters, "tyre": tyre, "sensors": sensors}, "here")


def test_the_genesis_has_its_published_stiffness_and_the_gradient_of_the_textbook():
    """Govindarajan 2018 has 152838 and 269702 N/rad; Pacejka 2012, 1.3.2: EG = m (l_r / C_f - l_f / C_r) / l."""
    found = axle_values(spec(*CASES[0]))
    assert found["axle_stiffness_front"] == pytest.approx(152838, rel=1e-4)
    assert found["axle_stiffness_rear"] == pytest.approx(269702, rel=1e-4)
    m, l_f, l_r = (genesis.VALUES[n] for n in ("mass", "cog_to_front_axle", "cog_to_rear_axle"))
    assert found[GRADIENT] == pytest.approx(m * (l_r / 152838 - l_f / 269702) / (l_f + l_r), rel=1e-4)


@pytest.mark.parametrize("case", CASES, ids=lambda c: f"{c[0]}+{c[1]}")
def test_parameters_follow_so_that_the_quantity_is_as_stated(case):
    model = spec(*case)
    believed = axle_values(model)
    assert set(believed) == {p for p in derived_parameters(model) if not p.startswith("payload")}
    for name, value in believed.items():
        wanted = 0.8 * value + (0.002 if name == GRADIENT else 0.0)
        changed = axle_values(model, model.values | settled(model, {name: wanted}))
        assert changed[name] == pytest.approx(wanted, rel=1e-9)
        others = [n for n in believed if n not in (name, GRADIENT)]
        if name != GRADIENT:
            assert {n: changed[n] for n in others} == pytest.approx({n: believed[n] for n in others})
        else:  # opposite factors
            first, second = others[:2]
            assert changed[first] * changed[second] == pytest.approx(believed[first] * believed[second])


def test_stiffness_is_that_at_the_loads_of_the_run():
    model = spec(*CASES[0])
    varied = {"mass": np.array([2000.0, 2600.0]), "axle_stiffness_rear": np.array([2e5, 2e5])}
    for i, mass in enumerate(varied["mass"]):
        values = model.values | {n: v[i] for n, v in settled(model, varied).items()}
        assert values["mass"] == mass
        assert axle_values(model, values)["axle_stiffness_rear"] == pytest.approx(2e5)


def study(*factors):
    content = {
        "name": "stiffness",
        "targets": ["lateral_velocity"],
        "plant": {
            "vehicle": "car",
            "parameters": "govindarajan_2018",
            "tyre": "magic_formula",
            "sensors": "car_series",
        },
        "estimator": ["ekf"],
        "drive": [{"name": "sine", "kind": "sine", "speed": "15 m/s"}],
        "design": [{"name": "level", "repeats": 4, "factor": list(factors)}],
    }
    return build_study(content, "study.toml")


def test_a_study_varies_the_stiffness_of_an_axle():
    built = study({"parameter": "axle_stiffness_front", "shift": ["-10 %", "10 %"]})
    (factor,) = built.designs[0].factors
    assert factor.nominal == pytest.approx(152838, rel=1e-4)
    softer = settled(built.plant, {"axle_stiffness_front": factor.levels[0]})
    assert softer == {"stiffness_peak_front": pytest.approx(0.9 * genesis.VALUES["stiffness_peak_front"])}


@pytest.mark.parametrize("other", ["stiffness_peak_rear", "axle_stiffness_rear"])
def test_two_factors_on_one_stiffness_are_refused(other):
    with pytest.raises(UserError, match=f"'{other}' of the plant follows from 'understeer_gradient'"):
        study({"parameter": GRADIENT, "levels": [0.001, 0.003]}, {"parameter": other, "shift": ["-10 %", "10 %"]})
