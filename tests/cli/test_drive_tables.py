from pathlib import Path

import numpy as np
import pytest

import harness.models.drives.sine
import harness.models.vehicles.semitrailer
from harness.cli import drive_tables
from harness.models.contracts import DriveContext, Profile
from harness.simulation.drives import build_drive, read_drives

ROOT = Path(__file__).resolve().parents[2]
SETS = {name: ROOT / "studies" / "drives" / f"{name}.toml" for name in ("robustness", "robustness-broad")}
CONTEXT = DriveContext(wheelbase=3.71, steering_ratio=23.0, step=0.01)


# --- the two sets of six drives ---


@pytest.fixture(scope="module")
def sets():
    return {
        name: {drive: build_drive(kind, options, CONTEXT) for drive, (kind, options) in read_drives(path).items()}
        for name, path in SETS.items()
    }


@pytest.fixture(scope="module")
def peaks(sets):
    return {name: drive_tables.reference_peaks(profiles, [8e3, 24e3, 32e3]) for name, profiles in sets.items()}


def test_the_dissertations_kinds_are_there(sets):
    kinds = {name: kind for name, (kind, _) in read_drives(SETS["robustness"]).items()}
    assert len(kinds) == 6
    assert kinds["two-ramps"] == "double_ramp"
    assert {"ramp", "steady_circle", "sine"} <= set(kinds.values())
    right_first = sets["robustness"]["two-ramps"].steering_wheel_angle
    assert np.argmin(right_first) < np.argmax(right_first)  # a right turn is negative (ISO 8855)
    growing = sets["robustness"]["growing-circle"].steering_wheel_angle
    assert (np.diff(growing) >= -1e-12).all()
    assert growing[-1] > growing[len(growing) // 2] > 0


def test_the_broad_set_covers_speed_and_length(sets):
    six = sets["robustness-broad"].values()
    assert len(six) == 6
    assert all(60 <= p.time[-1] <= 120 for p in six)
    assert min(p.speed.min() for p in six) == pytest.approx(1.5)
    assert max(p.speed.max() for p in six) == pytest.approx(22)


def test_all_are_lively_but_stable_at_every_mass(peaks):
    for found in peaks.values():
        for name, peak in found.items():
            assert np.isfinite(peak["articulation_angle"]).all(), name
            assert 1.2 < peak["lateral_acceleration_tractor"].max() < 2.7, name
            assert peak["lateral_acceleration_trailer"].max() < 2.6, name
    turned = peaks["robustness-broad"]["tight-turn"]["articulation_angle"]
    np.testing.assert_allclose(np.degrees(turned), 60, atol=2)


@pytest.mark.parametrize("name", SETS)
def test_the_command_prints_the_peaks_of_every_drive(name, sets, peaks, monkeypatch, capsys):
    monkeypatch.setattr(drive_tables, "reference_peaks", lambda profiles, masses: peaks[name])
    assert drive_tables.main([str(SETS[name])]) == 0
    rows = {r.split("`")[1]: r for r in capsys.readouterr().out.splitlines() if r.startswith("| `")}
    assert set(rows) == set(sets[name])
    for drive, row in rows.items():
        angles = np.degrees(peaks[name][drive]["articulation_angle"])
        assert " / ".join(f"{angle:.1f}" for angle in angles) in row, drive


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
    with pytest.raises(SystemExit, match="2"):
        drive_tables.main([])
    assert "usage" in capsys.readouterr().err
    assert drive_tables.main([str(tmp_path / "none.toml")]) == 2
    assert drive_tables.main(["--kinds"]) == 0
    assert capsys.readouterr().out == drive_tables.kinds_table() + "\n"
