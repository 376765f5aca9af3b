"""What ``harness observability`` draws, prints and refuses."""

import pytest

from harness.cli.observability_report import plot, report
from harness.common.errors import UserError
from harness.config import resolve_single
from harness.estimation.observability import delays, structural_observability, synthetic_manoeuvre


def truck(**more):
    table = {"vehicle": "semitrailer", "parameters": "ziaukas_2023", "tyre": "magic_formula", "sensors": "series"}
    return resolve_single({**table, **more}, "test")


def test_figure_says_what_it_shows():
    spec = truck(values={"constraint_rate": 0.0})
    model = spec.model().augment(["steering_wheel_angle"])
    printed = structural_observability(model, spec.values, synthetic_manoeuvre())
    figure = plot(printed)
    share = f"{float(printed['observable'].mean()):.0%}"
    assert share in figure.get_suptitle()
    assert "deg" in figure.axes[0].get_ylabel()
    assert figure.axes[2].get_xlabel() == "time in s"
    assert len(figure.axes[2].get_yticklabels()) == 11


def test_report_writes_the_figure_and_prints_the_delay(tmp_path, capsys):
    spec = truck(values={"constraint_rate": 0.0})
    found = report(spec, ["steering_wheel_angle"], tmp_path / "new")
    assert (tmp_path / "new" / "observability.svg").read_text().lstrip().startswith("<?xml")
    printed_text = capsys.readouterr().out
    report(spec, ["steering_wheel_angle"], tmp_path / "again")
    assert (tmp_path / "again" / "observability.svg").read_bytes() == (
        tmp_path / "new" / "observability.svg"
    ).read_bytes()
    assert f"{delays(found)['rank']:.2f} s" in printed_text
    assert "articulation_angle" in printed_text


def test_report_checks_the_model_with_its_effects(tmp_path):
    found = report(truck(effects=["steering_lag"], values={"steering_lag": "0.1 s"}), [], tmp_path)
    assert "steering_lagged" in found["state"]


def test_report_refuses_an_unknown_input_that_is_none(tmp_path):
    with pytest.raises(UserError, match="closest: steering_wheel_angle"):
        report(truck(), ["steering"], tmp_path)


def test_a_folder_that_cannot_be_made_is_one_clear_error(tmp_path):
    (tmp_path / "file").write_text("taken")
    with pytest.raises(UserError, match="cannot write the figure"):
        report(truck(), [], tmp_path / "file" / "sub")
