"""A design that is interrupted goes on and ends with the same bits; a file that was cut off is computed again."""

import json
from dataclasses import replace

import pytest

from harness.config.parameter_set import set_text
from harness.experiment.files import RESULT, contents
from harness.experiment.information import EstimationGoal
from harness.experiment.kept_drives import TRIED
from harness.experiment.limits import Limits
from harness.experiment.report import write_design
from harness.experiment.run import DesignTask, design_drives
from support.identification import CAR, model_of

FREE = ("stiffness_over_load_front", "mass_over_inertia")


@pytest.fixture
def task(tmp_path):
    """Return the task of a design from a fit of a car, in a folder as harness identify writes it."""
    spec = model_of({**CAR, "integrator": "rk4"})
    fit = tmp_path / "fit"
    fit.mkdir()
    (fit / "parameters.toml").write_text(set_text(spec, "test", {}))
    rows = [
        {"name": n, "value": spec.values[n], "standard_error": 0.3 * spec.values[n], "verdict": "weakly determined"}
        for n in FREE
    ]
    content = {"method": "likelihood", "estimates": rows, "correlation": [[1.0, 0.2], [0.2, 1.0]],
               "drives": [{"outputs": list(spec.model().outputs)}]}  # fmt: skip
    (fit / "identify.json").write_text(json.dumps(content))
    limits = Limits(lateral_acceleration=4.0, duration=8.0)
    manoeuvres = ("step", "circle")
    return DesignTask(fit, limits=limits, budget=16.0, manoeuvres=manoeuvres, effort=10, jobs=1, out=tmp_path / "out")


class Counter:
    """Counts the drives whose information is computed, and interrupts behind so many."""

    def __init__(self, monkeypatch, most=None):
        self.count, evidence = 0, EstimationGoal.evidence

        def counted(goal, drive):
            if self.count == most:
                raise KeyboardInterrupt
            self.count += 1
            return evidence(goal, drive)

        monkeypatch.setattr(EstimationGoal, "evidence", counted)


def test_an_interrupted_design_goes_on_with_the_same_bits(task, tmp_path, monkeypatch):
    with monkeypatch.context() as patch:
        whole = Counter(patch)
        undisturbed = contents(design_drives(replace(task, out=None)))
    for most in (3, 5):
        with monkeypatch.context() as patch:
            Counter(patch, most)
            with pytest.raises(KeyboardInterrupt):
                design_drives(task)
        assert not (task.out / RESULT).exists()
    kept = sorted((task.out / TRIED).iterdir())
    kept[0].write_bytes(kept[0].read_bytes()[:50])  # as a full disk leaves it
    rest = Counter(monkeypatch)
    designed = design_drives(task)
    assert whole.count - 8 <= rest.count <= whole.count - 7
    write_design(designed, task.out, "test")
    assert {name: (task.out / name).read_text() for name in undisturbed} == undisturbed
    assert not (task.out / TRIED).exists()


@pytest.mark.parametrize("changed", [{"seed": 1}, {"limits": Limits(lateral_acceleration=3.9, duration=8.0)}])
def test_what_is_kept_is_of_the_same_design_alone(task, changed, monkeypatch):
    design_drives(task)
    of_more = Counter(monkeypatch)
    design_drives(replace(task, effort=12))  # begins with the same drives
    assert 0 < of_more.count <= 4
    again = Counter(monkeypatch)
    design_drives(replace(task, **changed, effort=4))
    assert again.count > 4


def test_another_fit_takes_over_nothing(task, monkeypatch):
    design_drives(replace(task, effort=2))
    file = task.folder / "identify.json"
    file.write_text(file.read_text().replace('"standard_error": ', '"standard_error": 1'))
    again = Counter(monkeypatch)
    design_drives(replace(task, effort=2))
    assert again.count == 4
