import re
from pathlib import Path

import numpy as np
import pytest

import harness.models.drives.sine
import harness.models.vehicles.semitrailer
from harness.cli import drive_tables
from harness.models.contracts import DriveContext, Profile
from harness.simulation.drives import build_drive, read_drives

ROOT = Path(__file__).resolve().parents[2]
ROBUSTNESS = ROOT / "studies" / "drives" / "robustness.toml"
CONTEXT = DriveContext(wheelbase=3.71, steering_ratio=23.0, step=0.01)


# --- the six default drives ---


@pytest.fixture(scope="module")
def six():
    return {
        name: (kind, build_drive(kind, options, CONTEXT)) for name, (kind, options) in read_drives(ROBUSTNESS).items()
    }


@pytest.fixture(scope="module")
def peaks(six):
    profiles = {name: profile for name, (_, profile) in six.items()}
    return drive_tables.reference_peaks(profiles, [8e3, 24e3, 32e3])


def test_the_six_cover_speed_and_length(six):
    assert len(six) == 6
    assert {"winding-road", "tight-turn", "steady-circle", "highway"} <= set(six)
    assert all(60 <= p.time[-1] <= 120 for _, p in six.values())
    assert min(p.speed.min() for _, p in six.values()) == pytest.approx(1.5)
    assert max(p.speed.max() for _, p in six.values()) == pytest.approx(22)


def test_the_six_are_lively_but_stable_at_every_mass(peaks):
    for name, found in peaks.items():
        assert np.isfinite(found["articulation_angle"]).all(), name
        assert found["lateral_acceleration_trailer"].max() < 2.6, name
        assert found["lateral_acceleration_tractor"].max() > (1.2 if name == "tight-turn" else 1.8), name
    np.testing.assert_allclose(np.degrees(peaks["tight-turn"]["articulation_angle"]), 60, atol=2)


def test_the_documentation_is_what_the_commands_print(six, peaks, monkeypatch, capsys):
    text = (ROOT / "docs" / "drives.md").read_text(encoding="utf-8")
    assert drive_tables.kinds_table() in text, "renew docs/drives.md with: python -m harness.cli.drive_tables --kinds"
    monkeypatch.setattr(drive_tables, "reference_peaks", lambda profiles, masses: peaks)
    assert drive_tables.main([str(ROBUSTNESS)]) == 0
    printed = capsys.readouterr().out.strip()
    documented = text.split("<!-- peaks -->\n")[1].split("\n<!-- end of peaks -->")[0]
    number = re.compile(r"(?<![\w-])\d+(?:\.\d+)?")
    assert number.sub("#", printed) == number.sub("#", documented)
    shown = [[float(n) for n in number.findall(t)] for t in (printed, documented)]
    np.testing.assert_allclose(*shown, atol=0.11)  # another machine may round the last digit otherwise


def test_a_run_that_leaves_the_model_is_reported_as_lost(monkeypatch):
    monkeypatch.setitem(harness.models.vehicles.semitrailer.VALID, "articulation_angle", 0.1)
    time = np.arange(1000) * 0.01
    folding = Profile(time, 5.0 * np.clip(time / 4, 0, 1), np.full(1000, 3.0))
    calm = Profile(time[:500], np.zeros(500), np.full(500, 20.0))
    found = drive_tables.reference_peaks({"folding": folding, "calm": calm}, [24e3])
    assert np.isnan(found["folding"]["articulation_angle"]).all()
    assert found["calm"]["articulation_angle"] == 0


# --- the file of drives and the command ---


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("drive = 3", "holds no [[drive]] table"),
        ("", "holds no [[drive]] table"),
        ("[[drive]", "not valid TOML"),
        ("[[drive]]\nname = 'a'", "number 1: 'kind' is missing"),
        ("[[drive]]\nkind = 'sine'", "number 1: 'name' is missing"),
        ("[[drive]]\nname='a'\nkind='sine'\n[[drive]]\nname='a'\nkind='step'", "two drives are named 'a'"),
        ("[[drive]]\nname = 'a'\nkind = 'sine'\nspeed = '3 kg'", "drive 'a', speed: '3 kg' does not fit"),
        ("[[drive]]\nname = 'a'\nkind = 'sine'\namplitude = '90 deg'", "drive 'a': asks for"),
    ],
)
def test_command_refuses_a_bad_file_with_one_message(tmp_path, capsys, text, message):
    path = tmp_path / "drives.toml"
    path.write_text(text)
    assert drive_tables.main([str(path)]) == 2
    shown = capsys.readouterr()
    assert shown.out == ""
    assert shown.err.startswith(f"error: {path}")
    assert message in shown.err
    assert shown.err.count("\n") == 1


def test_command_without_or_with_absent_file(tmp_path, capsys):
    assert drive_tables.main([]) == 2
    assert "usage" in capsys.readouterr().err
    assert drive_tables.main([str(tmp_path / "none.toml")]) == 2
    assert drive_tables.main(["--kinds"]) == 0
    assert capsys.readouterr().out == drive_tables.kinds_table() + "\n"
