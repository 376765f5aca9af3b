"""The figures of exported estimators: small forms of their tables."""

import shutil

import pytest

from bench import export, export_tools, fmu_container
from harness.common.errors import UserError, WorkError
from support.observers import needs_compiler


def row(out, study="steering"):
    """Return the cells behind the names of the only row of a table."""
    lines = [line.split() for line in out.splitlines() if line.strip()]
    assert lines[-1][:2] == [study, "ekf"]
    return lines[-1][2:]


@needs_compiler
@pytest.mark.proof
@pytest.mark.parametrize("more", [[], ["--sanitize"]])
def test_steps_of_c_and_kernel_are_compared(more, capsys):
    export.main(["--study", "steering", "--estimator", "ekf", "--steps", "800", *more])
    cells = row(capsys.readouterr().out)
    lines, memory, code, stack, first, all_of_eight, rounded, above, time = (float(c.replace(",", "")) for c in cells)
    assert 500 < lines < 2000
    assert 4000 < memory < 8000
    assert 5000 < code < 50000
    assert 500 < stack < 5000
    assert 0 < first <= all_of_eight < 1e-12
    assert 0 < rounded < 1e-11
    assert above == 0.0
    assert 10 < time < 1e6


@needs_compiler
@pytest.mark.proof
def test_single_precision_is_compared_over_a_drive(capsys):
    export.main(["--study", "steering", "--estimator", "ekf", "--single", "--duration", "10 s"])
    memory, most, at, left = row(capsys.readouterr().out)
    assert float(memory.replace(",", "")) < 4000
    assert 0 < float(most) < 0.1
    assert (at, left) == ("nan", "no")


@needs_compiler
@pytest.mark.proof
def test_so_are_those_of_a_car_whose_accelerometer_is_not_linear(capsys):
    export.main(["--study", "forces", "--estimator", "ekf", "--steps", "800"])
    *_, first, all_of_eight, _, above, _ = row(capsys.readouterr().out, "forces")
    assert 0 < float(first) <= float(all_of_eight) < 1e-12
    assert float(above) == 0.0


@needs_compiler
@pytest.mark.proof
def test_tools_of_control_units_have_nothing_new_to_say(capsys, tmp_path, monkeypatch):
    with pytest.raises(UserError, match="no folder that harness export wrote"):
        export_tools.main([str(tmp_path)])
    export_tools.main(["--estimator", "narx"])
    out = capsys.readouterr().out
    messages, code, stack, *ran = row_of_tools(out)
    if shutil.which("cppcheck"):
        assert int(messages) > 50
        monkeypatch.setattr(export_tools, "DEVIATIONS", {"12.1": "advisory"})
        with pytest.raises(WorkError, match=r"cppcheck says 10\.8, .* which nobody has justified"):
            export_tools.main(["--estimator", "narx"])
    else:
        assert "not installed, and left out: cppcheck" in out
    if shutil.which(export_tools.COMPILER):
        assert 3000 < int(code.replace(",", "")) < 20000
        assert 100 < int(stack.replace(",", "")) < 2000
    else:
        assert f"left out: {export_tools.COMPILER}" in out
    emulates = shutil.which(export_tools.COMPILER) and shutil.which(export_tools.EMULATOR)
    assert " ".join(ran) == ("as recorded" if emulates else "–")


def row_of_tools(out):
    """Return the cells behind the name of the first row."""
    (line,) = (line.split() for line in out.splitlines() if line.split()[:2] == ["steering", "narx"])
    return line[2:]


@needs_compiler
@pytest.mark.proof
def test_fmus_run_in_the_container_of_another_importer(capsys, monkeypatch):
    with monkeypatch.context() as patch:
        patch.setenv("PATH", "")
        with pytest.raises(UserError, match="not installed: fmutool, fmucontainer; pip install"):
            fmu_container.main([])
    if shutil.which("fmucontainer") is None:
        pytest.skip("the FMU Manipulation Toolbox is not installed")
    pytest.importorskip("fmpy", reason="FMPy is not installed")
    fmu_container.main([])
    out = capsys.readouterr().out
    assert out.count("both comply") == 2
    assert out.count("differs from a loop by 0 N and 0 N") == 2
