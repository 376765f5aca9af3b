"""Studies of a plant that is an FMU: scores of the built-in plant, faults that lose their run only."""

from functools import partial
from pathlib import Path

import numpy as np
import pytest
import sympy as sp

from harness.common.files import parse_toml
from harness.config import build_study
from harness.config.alone import alone
from harness.config.self_contained import self_contained
from harness.engine.codegen.derivatives import derive
from harness.models.signals import SIGNALS
from harness.simulation.external_plant import ExternalPlant
from harness.study.design import units
from harness.study.evaluate import StudyEvaluator
from harness.study.score_names import LOST, OK, STATUS
from support.fmus import make, needs_compiler, of_model

pytestmark = needs_compiler

STUDY = {
    "name": "mass",
    "title": "How wrong do the estimators get when the trailer is heavier or lighter than they believe?",
    "seed": 20230109,
    "targets": ["lateral_force_axle_21", "articulation_angle"],
    "drive": [{"name": "sine", "kind": "sine", "duration": "20 s", "amplitude": "40 deg", "speed": "50 km/h"}],
    "estimator": [{"name": "EKF", "kind": "ekf"}, {"name": "UKF", "kind": "ukf"}],
    "design": [
        {
            "name": "level",
            "repeats": 2,
            "factor": [{"parameter": "trailer_mass", "levels": ["8 t", "16 t", "24 t", "32 t"]}],
        }
    ],
}
SEMITRAILER = {
    "vehicle": "semitrailer",
    "parameters": "ziaukas_2023",
    "tyre": "magic_formula",
    "sensors": "series",
}
BELIEF = {**SEMITRAILER, "unknown_inputs": ["steering_wheel_angle"], "values": {"trailer_mass": "24 t"}}


def scores(study):
    evaluator = StudyEvaluator(study)
    results = [evaluator.evaluate(unit) for design in study.designs for unit in units(study, design)]
    lost = evaluator.lost() if study.plant.external else []
    if study.plant.external:
        evaluator.compiled.simulator.close()
    return {name: np.concatenate([r[name] for r in results]) for name in results[0]}, lost


@pytest.fixture(scope="module")
def built_in():
    return build_study({**STUDY, "plant": {**SEMITRAILER, "noise": {"process_scale": 0}}, "belief": BELIEF})


@pytest.fixture(scope="module")
def whole(built_in):
    return scores(built_in)[0]


def foreign(folder, built_in, version=2, kind="cs", timeout="60 s", **hooks):
    spec, model = built_in.plant, built_in.plant.model()
    published = list(dict.fromkeys((*model.states, *STUDY["targets"], *model.outputs)))
    make(folder, of_model(model, spec.values, published).faulty(**hooks), version, kind)
    plant = {"fmu": f"truck_{version}_{kind}.fmu", "map": "truck.toml", "sensors": "series", "timeout": timeout}
    tables = {"inputs": list(model.inputs), "outputs": published}
    (folder / "truck.toml").write_text(
        "\n".join(f"[{table}]\n" + "\n".join(f'{n} = "{n}"' for n in names) for table, names in tables.items())
        + "\n[limits]\narticulation_angle = '90 deg'\n"
    )
    return build_study({**STUDY, "plant": plant, "belief": BELIEF}, folder / "study.toml")


def test_a_run_alone_finds_the_fmu_and_its_map_from_any_folder(tmp_path, built_in):
    study = foreign(tmp_path, built_in)
    values = [f.levels[0] for f in study.designs[0].factors]
    (tmp_path / "elsewhere").mkdir()
    for content in (study.text, self_contained(study)):  # a store has the latter
        own = build_study(parse_toml(content, "text"), tmp_path / "study.toml")
        text = alone(own, own.designs[0], own.drives[0].name, values, own.count_from).text
        again = build_study(parse_toml(text, "text"), tmp_path / "elsewhere" / "study.toml")
        assert Path(again.plant.external.description.file) == tmp_path / "truck_2_cs.fmu"
        ExternalPlant(again.plant).close()


@pytest.mark.parametrize(("version", "kind"), [(2, "cs"), (2, "me"), (3, "cs"), (3, "me")])
def test_the_scores_of_the_mass_study_are_those_of_the_built_in_plant(version, kind, tmp_path, built_in, whole):
    theirs, lost = scores(foreign(tmp_path, built_in, version, kind))
    assert lost == []
    assert (theirs[STATUS] == OK).all()
    for name in whole:
        np.testing.assert_allclose(theirs[name], whole[name], rtol=1e-6, atol=1e-12, err_msg=name)


def in_python(model, values, published):
    """Return the equations of a vehicle of the harness as a Python class with Euler's steps."""
    derived = derive(model, published, jacobians=False)
    code = partial(sp.pycode, user_functions={"larger": "max", "smaller": "min"}, fully_qualified_modules=True)
    units = {n: SIGNALS[n].unit if n in SIGNALS else "m/s^2" for n in (*model.inputs, *published)}
    starts = {s: model.start.get(s, 0.0) for s in model.states}
    first = [float(values.get(v, 0.0) if isinstance(v, str) else v) for v in starts.values()]
    read = [f"{n} = u['{n}']" for n in model.inputs] + [f"{n} = p['{n}']" for n in model.parameter_names]
    read += [f"{n} = x[{i}]" for i, n in enumerate(model.states)]
    read += [f"{n} = {code(value)}" for n, value in {**derived.constants, **derived.assignments}.items()]
    rates = ", ".join(code(value) for value in derived.derivatives)
    given = ", ".join(f"'{n}': {code(derived.signals[n])}" for n in published)
    body = [*read, f"rates = [{rates}]", f"published = {{{given}}}"]
    body += ["self.x = [a + dt * b for a, b in zip(x, rates)]", "return published"]
    parameters = {p.name: {"value": values[p.name], "unit": p.unit} for p in model.parameters}
    return "\n".join(
        [
            "import math",
            "class Truck:",
            f"    inputs = { {n: units[n] for n in model.inputs} }",
            f"    outputs = { {n: units[n] for n in published} }",
            f"    parameters = {parameters}",
            "    def reset(self, p):",
            f"        self.p, self.x = p, {first}",
            "    def step(self, u, dt):",
            "        p, x = self.p, self.x",
            *(f"        {line}" for line in body),
        ]
    )


def test_the_semitrailer_as_python_class_scores_as_the_built_in_one(tmp_path, built_in, whole):
    spec, model = built_in.plant, built_in.plant.model()
    published = list(dict.fromkeys((*model.states, *STUDY["targets"], *model.outputs)))
    (tmp_path / "truck.py").write_text(in_python(model, spec.values, published))
    plant = {"python": "truck:Truck", "sensors": "series"}
    theirs, lost = scores(build_study({**STUDY, "plant": plant, "belief": BELIEF}, tmp_path / "study.toml"))
    assert lost == []
    for name in whole:
        np.testing.assert_allclose(theirs[name], whole[name], rtol=1e-6, atol=1e-12, err_msg=name)


FAULTS = {
    "crash": ("*(volatile int *)0 = 1;", "SIGSEGV"),
    "hang": ("for (;;);", "within 4 s"),
    "error": ('say(m, "no road"); return 3;', "no road"),
    "NaN": ("m->x[0] = NAN;", "is nan"),
}


@pytest.mark.parametrize("fault", FAULTS)
def test_a_fault_loses_its_runs_and_all_others_keep_their_bits(fault, tmp_path, built_in):
    code, reason = FAULTS[fault]
    for folder in ("whole", "broken"):
        (tmp_path / folder).mkdir()
    mass = built_in.plant.model().parameter_names.index("trailer_mass")
    step = f"if (m->r[NU + {mass}] == 16000.0 && t > 1.0) {{ {code} }}"
    whole, _ = scores(foreign(tmp_path / "whole", built_in))
    broken, lost = scores(foreign(tmp_path / "broken", built_in, timeout="4 s", STEP=step))
    lost_ones = (broken[STATUS] == LOST).reshape(len(broken[STATUS]), -1).any(axis=1)
    assert lost_ones.any()
    assert not lost_ones.all()
    for name, values in whole.items():
        assert broken[name][~lost_ones].tobytes() == values[~lost_ones].tobytes(), name
    assert len(lost) == 1
    assert reason in lost[0]
