"""Text as loggers write it: preambles, clocks, long form, decimal signs; what is not understood is named."""

import runpy
from pathlib import Path

import numpy as np
import pytest

from harness.common.errors import UserError
from harness.recordings import load_recording, readers
from harness.recordings.proposal.propose import propose

CASES = Path(__file__).parents[3] / "shared" / "cases"
TIME = np.arange(0.0, 12.0, 0.02)
SPEED = 20.0 + 3.0 * np.sin(0.3 * TIME)
TURN = 8.0 * np.sin(0.8 * TIME)


def rows(separator=",", point=".", stamps=None, quote=""):
    """Return lines of time, speed in km/h and yaw rate in deg/s."""
    stamps = [f"{t:.2f}" for t in TIME] if stamps is None else stamps
    cells = zip(stamps, 3.6 * SPEED, TURN, strict=True)
    numbers = ((str(t), *(f"{x:.6f}" for x in values)) for t, *values in cells)
    return [separator.join(f"{quote}{c.replace('.', point)}{quote}" for c in row) for row in numbers]


HEADER, UNITS = "Time,Speed,Yaw Rate", "s,km/h,deg/s"
MOTEC = [
    '"Format","MoTeC CSV File",,,"Workbook",""',
    '"Log Time","10:00:00",,,"Origin Time","0.0","s"',
    '"Duration","12"',
]
LVM = ["LabVIEW Measurement\t", "Separator\tTab", "Date\t2014/12/01", "***End_of_Header***\t", "\t", "Channels\t2\t\t"]
TORQUE = [f"05-May-2025 10:00:{t:06.3f}" for t in TIME]
OVER_MIDNIGHT = [f"{'05.05.2025 23:59' if t < 6 else '06.05.2025 00:00'}:{(54 + t) % 60:06.3f}" for t in TIME]
FORMS = {
    "motec.csv": [*MOTEC, "", HEADER.replace(",", '","').join('""'), UNITS, "", "", *rows(quote='"')],
    "racechrono.csv": ["Made by x v9.0 ( http://x/ ).", "Format,3", "", HEADER, UNITS, ",100: gps,101: imu", *rows()],
    "titles.txt": ["of a car", "[column names]", "Time Speed Yaw", "[data]", *rows(" ")],
    "names.txt": ["a car, on Monday", "Time [s]  Vehicle Speed [km/h]  Yaw Rate [deg/s]", *rows("  ")],
    "german.csv": ["Messung;12,5", "Zeit;Geschwindigkeit;Gierrate", "s;km/h;°/s", *rows(";", ",")],
    "excel.csv": ["sep=;", "Time;Speed [km/h];Yaw Rate [deg/s]", *rows(";", ",")],
    "quoted.csv": ['"Time","Speed (km/h)","Yaw Rate (deg/s)"', *rows(",", ",", quote='"')],
    "labview.lvm": [*LVM, "X_Value\tSpeed\tYaw Rate\tComment", *rows("\t", ",")],
    "iso.csv": [HEADER, *rows(stamps=[f"2025-05-05T10:00:{t:09.6f}+02:00" for t in TIME])],
    "packed.csv": [HEADER, *rows(stamps=[f"20250505T1000{t:09.6f}Z" for t in TIME])],
    "torque.csv": [HEADER, *rows(stamps=TORQUE)],
    "day_month.csv": [HEADER.replace(",", ";"), *rows(";", stamps=OVER_MIDNIGHT)],
    "midnight.csv": ["Uhrzeit,Speed,Yaw Rate", *rows(stamps=[s[11:] for s in OVER_MIDNIGHT])],
    "am_pm.csv": [HEADER, *rows(stamps=[f"5/6/2025 11:59:{t:06.3f} PM" for t in TIME])],
    "minutes.csv": [HEADER, *rows(stamps=[f"09:{t:06.3f}" for t in TIME])],
    "days.csv": [HEADER, *rows(stamps=[f"{45782.5 + t / 86400:.10f}" for t in TIME])],
    "seconds.csv": [HEADER, *rows(stamps=[f"10:00:{int(t):02d}" for t in TIME])],
    "pair.csv": [
        "stamp.sec,stamp.nanosec,Speed,Yaw Rate",
        *rows(stamps=[f"{1746439200 + int(t)},{round(t % 1 * 1e9) % 10**9}" for t in TIME]),
    ],
    "tv.csv": [
        "tv_sec,tv_usec,Speed,Yaw Rate",
        *rows(stamps=[f"{1746439200 + int(t)},{round(t % 1 * 1e6) % 10**6}" for t in TIME]),
    ],
    "three.csv": [
        "t,path,data",
        *(f"{t:.2f},{n},{v}" for t, v, r in zip(TIME, 3.6 * SPEED, TURN, strict=True)
          for n, v in (("Speed [km/h]", v), ("Yaw Rate [deg/s]", r))),
    ],
    "long.csv": [
        "Timestamp;Signal Name;Value;Unit",
        *(f"{t:.2f};{n};{v};{u}" for t, v, r in zip(TIME, 3.6 * SPEED, TURN, strict=True)
          for n, v, u in (("Speed", v, "km/h"), ("Yaw Rate", r, "deg/s"))),
    ],
}  # fmt: skip


@pytest.mark.parametrize("name", FORMS)
def test_a_form_is_proposed_a_map_for_and_read(tmp_path, name):
    path = tmp_path / name
    path.write_bytes("\r\n".join(FORMS[name]).encode("cp1252"))
    (tmp_path / "map.toml").write_text(propose(path).text, encoding="utf-8")
    recording = load_recording(path, tmp_path / "map.toml")
    count = recording.sizes["time"]
    assert count in (len(TIME) - 1, len(TIME))
    np.testing.assert_allclose(recording["time"], TIME[:count], atol=1e-3)
    np.testing.assert_allclose(recording["speed"], SPEED[:count], atol=2e-3)
    np.testing.assert_allclose(recording["yaw_rate"], np.radians(TURN)[:count], atol=2e-4)


@pytest.mark.skipif(not CASES.is_dir(), reason="the cases of users are not here")
@pytest.mark.parametrize("case", ["10-racing-loggers", "14-clocks"])
def test_the_cases_of_users_are_read(tmp_path, monkeypatch, case):
    monkeypatch.chdir(tmp_path)
    runpy.run_path(str(CASES / case / "make.py"))
    made = sorted(tmp_path.iterdir())
    assert len(made) >= 4
    for path in made:
        (tmp_path / "map.toml").write_text(propose(path).text, encoding="utf-8")
        recording = load_recording(path, tmp_path / "map.toml")
        assert recording.sizes["time"] == pytest.approx(3000 if case.startswith("10") else 2000, abs=3), path
        assert float(recording["time"][-1]) == pytest.approx(60 if case.startswith("10") else 40, abs=0.1), path


@pytest.mark.parametrize(
    ("lines", "message"),
    [
        (
            [HEADER, *rows(stamps=["noon" if t == 0.2 else f"10:00:{t:05.2f}" for t in TIME])],
            "row 11 .*'noon' is no time",
        ),
        (["by a car", "of mine", "on Monday", *rows(" ")], "from line 4 on rows hold 3 cells, but no row above"),
        (
            ["t,v", *(f"0{1 + d}/0{2 + d}/2025 10:00:00.{i},1" for d in (0, 1) for i in range(9))],
            "may be month and day or",
        ),
        (["t,v", *(f"2025-13-01 10:00:00.{i},1" for i in range(9))], "'2025-13-01' is no date"),
    ],
)
def test_what_is_not_understood_is_named(tmp_path, lines, message):
    path = tmp_path / "a.csv"
    path.write_text("\n".join(lines), encoding="utf-8")
    with pytest.raises(UserError, match=message):
        readers.read(path)


def test_a_clock_of_text_that_is_not_read_is_named_with_what_to_write(tmp_path):
    path = tmp_path / "a.csv"
    path.write_text("\n".join([HEADER, *rows(stamps=[f"10h00m{t:.2f}" for t in TIME])]), encoding="utf-8")
    assert "'10h00m0.00'" in propose(path).left_out["Time"]
    mapped = {"time": {"channel": "Time", "unit": "s"}, "yaw_rate": {"channel": "Yaw Rate", "unit": "deg/s"}}
    with pytest.raises(UserError, match=r"'Time' is text that is no time .*ISO 8601"):
        load_recording(path, mapped)


MAPPED = {"time": {"channel": "Time", "unit": "s"}, "speed": {"channel": "Speed"}, "yaw_rate": {"channel": "Yaw Rate"}}


def test_units_of_the_file_are_taken_or_said_to_be_others(tmp_path):
    path = tmp_path / "a.csv"
    path.write_text("\n".join([HEADER, UNITS, *rows()]), encoding="utf-8")
    recording = load_recording(path, MAPPED)
    np.testing.assert_allclose(recording["speed"], SPEED, atol=1e-6)
    assert recording.attrs["warnings"] == []
    other = load_recording(path, {**MAPPED, "speed": {"channel": "Speed", "unit": "m/s"}})
    assert other.attrs["warnings"] == ["speed: 'Speed' is in km/h by the file, in m/s by the map, which holds"]
    np.testing.assert_allclose(other["speed"], 3.6 * SPEED, atol=1e-6)


@pytest.mark.parametrize(
    ("stamps", "rate", "said"),
    [
        (np.floor(TIME / 0.05) * 0.05, None, "the rows are taken at 50 Hz, by the line"),
        (np.floor(TIME), "50 Hz", "at 50 Hz as stated"),
        (np.floor(TIME), "25 Hz", "takes the rows to 23.96 s, the stamps to 11 s"),
        (np.floor(np.where(TIME < 6, TIME, 6 + 3 * TIME)), None, 'state [recording] rate = "100 Hz"'),
        (np.where(np.arange(len(TIME)) % 9 == 1, 0, 1).cumsum() ** 1.5, None, "the last row of each stamp is kept"),
        (TIME + np.floor(TIME / 6) * 40 + 100054, None, "counts hours, minutes and seconds as digits"),
    ],
)
def test_stamps_that_repeat_or_are_digits(tmp_path, stamps, rate, said):
    path = tmp_path / "a.csv"
    path.write_text("\n".join([HEADER, UNITS, *rows(stamps=[f"{t:.4f}" for t in stamps])]), encoding="utf-8")
    content = {**MAPPED, "recording": {"rate": rate}} if rate else MAPPED
    try:
        (words,) = load_recording(path, content).attrs["warnings"][:1]
    except UserError as error:
        words = str(error)
    assert said in words
