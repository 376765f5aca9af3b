"""Files of racing loggers, test benches and simulators: VBO, XRK, TDMS, ERG, and what Simulink writes."""

import re
import struct
import sys
import zlib
from pathlib import Path

import libxrk
import numpy as np
import pyarrow as pa
import pytest
import scipy.io
from nptdms import ChannelObject, TdmsWriter

from harness.common.errors import UserError
from harness.recordings import readers
from harness.recordings.readers import xrk

CASES = Path(__file__).parents[3] / "shared" / "cases"
TIME = np.arange(200) * 0.01
VBO = """File created on 05/05/2025 at 23:59:59

[header]
satellites
time
latitude
longitude
velocity mph
Yaw rate

[channel units]
deg/s

[column names]
sats time lat long velocity YawRate

[data]
012 235959.98 +2880.60000000 -00660.30000000 030.000 +1.500E+00
012 000000.01 +2880.60000000 -00660.30000000 030.500 -2.500E+00
"""


@pytest.mark.parametrize("name", ["a.vbo", "a.VBO", "renamed.txt"])
def test_vbo_has_time_of_day_and_minutes_to_the_west(tmp_path, name):
    (tmp_path / name).write_bytes(VBO.replace("\n", "\r\n").encode())
    (table,) = readers.read_tables(tmp_path / name)
    assert table.clock == "time"
    np.testing.assert_allclose(table.columns["time"], [86399.98, 86400.01], atol=1e-9)
    np.testing.assert_allclose(table.columns["lat"], 48.01)
    np.testing.assert_allclose(table.columns["long"], 11.005)
    np.testing.assert_allclose(table.columns["YawRate"], [1.5, -2.5])
    assert table.units == {"time": "s", "lat": "deg", "long": "deg", "velocity": "mph", "YawRate": "deg/s"}


@pytest.mark.parametrize(
    ("old", "new", "said"),
    [
        ("[data]", "[rows]", r"lacks \[column names\] or \[data\]"),
        ("235959.98", "236059.98", "no time of day, hhmmss.ss"),
        ("030.500", "fast", "column 'velocity', row 2 of the data: 'fast' is no number"),
        ("-2.500E+00", "-2.500E+00 1 2 3", "is damaged or no VBO file"),
    ],
)
def test_a_damaged_vbo_is_refused_in_words(tmp_path, old, new, said):
    (tmp_path / "a.vbo").write_text(VBO.replace(old, new))
    with pytest.raises(UserError, match=said):
        readers.read(tmp_path / "a.vbo")


CHANNELS = [("RUNTIME", "s", ""), ("SLIPANGL", "deg", "1.0"), ("FYW", "N", "-1000.0"), ("LONGSLIP", "-", "1.0")]
TYDEX = (
    "**HEADER\nRELEASE   Release of TYDEX-Format                 1.3\n\n**CONSTANTS\n"
    "FZW       Vertical force                N         4000\n**MEASURCHANNELS\n! NAME DESCRIPTION\n"
    + "".join(f"{n:10}{'a channel of ' + n:30}{u:10}{f:10}0.0       0.0\n" for n, u, f in CHANNELS)
    + "**MEASURDATA\n0.00 -1.5 0.75 0.0\n0.01 -1.0 NOTAVAIL 0.1\n**MODELPARAMETERS\nFNOMIN 4000\n**END\n"
)


def test_tydex_has_channels_times_their_factors(tmp_path):
    (tmp_path / "a.TDX").write_bytes(TYDEX.replace("\n", "\r\n").encode())
    (table,) = readers.read_tables(tmp_path / "a.TDX")
    assert table.clock == "RUNTIME"
    assert table.units == {"RUNTIME": "s", "SLIPANGL": "deg", "FYW": "N", "LONGSLIP": "-"}
    np.testing.assert_array_equal(table.columns["FYW"], [-750.0, np.nan])
    np.testing.assert_array_equal(table.columns["SLIPANGL"], [-1.5, -1.0])


@pytest.mark.parametrize(
    ("old", "new", "said"),
    [
        ("**HEADER", "HEADER", "no TYDEX file, which begins with"),
        ("-1000.0   0.0 ", "-1000.0   0.5 ", "line 10: FYW has the factor -1000 and the offsets 0.5, 0"),
        ("-1000.0   0.0 ", "0.0       0.0 ", "line 10: FYW has the factor 0"),
        ("-1.0 NOTAVAIL", "-1.0NOTAVAIL", "line 14 has 3 values for 4 channels"),
        ("0.75 0.0", "0.7x 0.0", "line 13: '0.7x' is no number"),
        ("**MEASURDATA", "**DATA", "has no rows behind"),
    ],
)
def test_a_damaged_tydex_is_refused_in_words(tmp_path, old, new, said):
    assert old in TYDEX
    (tmp_path / "a.tdx").write_text(TYDEX.replace(old, new, 1))
    with pytest.raises(UserError, match=re.escape(said)):
        readers.read(tmp_path / "a.tdx")


def test_tdms_groups_have_their_clocks_and_units(tmp_path):
    def channel(group, name, values, **about):
        return ChannelObject(group, name, values, about)

    with TdmsWriter(tmp_path / "a.tdms") as file:
        imu = {"wf_increment": 0.01, "wf_start_offset": 0.5}
        file.write_segment([channel("imu", "v", 20 + TIME, unit_string="m/s", **imu), channel("imu", "r", TIME, **imu)])
        file.write_segment([channel("gps", "v", TIME[::10], wf_increment=0.1), channel("gps", "note", ["a", "b"])])
    imu, gps = readers.read_tables(tmp_path / "a.tdms")
    assert (list(imu.columns), imu.clock, imu.units) == (["imu.time", "imu.v", "r"], "imu.time", {"imu.v": "m/s"})
    np.testing.assert_allclose(imu.columns["imu.time"], 0.5 + TIME)
    np.testing.assert_array_equal(gps.columns["gps.v"], TIME[::10])
    np.testing.assert_allclose(gps.columns["gps.time"], TIME[::10], atol=1e-12)


INFO = """#INFOFILE1.1 - Do not remove this line!
File.Format = erg
File.ByteOrder = LittleEndian
File.At.1.Name = Time
File.At.1.Type = Double
Quantity.Time.Unit = s
File.At.2.Name = none
File.At.2.Type = 2 Bytes
File.At.3.Name = Car.v
File.At.3.Type = Float
Quantity.Car.v.Unit = m/s
"""


def erg(folder, info=INFO):
    records = np.zeros(len(TIME), np.dtype([("t", "<f8"), ("none", "V2"), ("v", "<f4")]))
    records["t"], records["v"] = TIME, 20 + TIME
    head = b"CM-ERG\0\0\1\0" + struct.pack("<H", records.itemsize) + bytes(4)
    (folder / "a.erg").write_bytes(head + records.tobytes() + b"cut")
    (folder / "a.erg.info").write_text(info)
    return folder / "a.erg"


def test_erg_is_read_by_its_info_file(tmp_path):
    (table,) = readers.read_tables(erg(tmp_path))
    assert (table.clock, table.units) == ("Time", {"Time": "s", "Car.v": "m/s"})
    np.testing.assert_array_equal(table.columns["Time"], TIME)
    np.testing.assert_array_equal(table.columns["Car.v"], (20 + TIME).astype("f4").astype(float))


@pytest.mark.parametrize(
    ("old", "new", "said"),
    [
        ("Float", "Quad", r"File.At.3 lacks a name, or a type that is known \('Quad'\)"),
        ("2 B", "4 B", "records of 16 bytes"),
    ],
)
def test_an_info_file_of_another_run_is_refused(tmp_path, old, new, said):
    with pytest.raises(UserError, match=said):
        readers.read(erg(tmp_path, INFO.replace(old, new)))
    (tmp_path / "a.erg.info").unlink()
    with pytest.raises(UserError, match=r"a\.erg\.info is not next to it"):
        readers.read(tmp_path / "a.erg")


def test_xrk_channels_share_a_table_where_they_share_stamps(tmp_path, monkeypatch, capsys):
    """The file is that of a real logger and not here: libxrk's answer stands in for it."""

    def channel(name, stamps, values, unit):
        about = libxrk.ChannelMetadata(units=unit).to_field_metadata()
        schema = pa.schema([("timecodes", pa.int64()), pa.field(name, pa.float32(), metadata=about)])
        return pa.table([pa.array(stamps), pa.array(values, pa.float32())], schema=schema)

    fast, slow = np.arange(100) * 10, np.arange(10) * 100
    channels = {
        "GPS Speed": channel("GPS Speed", fast, fast * 0.5, "km/h"),
        "Steer": channel("Steer", fast, fast, "deg"),
        "Temp": channel("Temp", slow, slow, "C"),
    }
    given = []

    def opened(content):
        given.append(content)
        print("unknown units")  # as libxrk does
        return libxrk.LogFile(channels=channels, laps=None, metadata={}, file_name="")

    monkeypatch.setattr(libxrk, "aim_xrk", opened)
    (tmp_path / "a.xrz").write_bytes(zlib.compress(b"<hCNF"))
    first, second = readers.read_tables(tmp_path / "a.xrz")
    assert given == [b"<hCNF"]
    assert capsys.readouterr().out == ""
    assert first.units == {"GPS Speed": "km/h", "Steer": "deg"}
    np.testing.assert_allclose(first.columns[first.clock], fast * 1e-3)
    np.testing.assert_allclose(second.columns["Temp"], slow)
    monkeypatch.setattr(xrk, "MOST_BYTES", 4)
    with pytest.raises(UserError, match="unpacked, has 5 bytes or more, at most 4 are read"):
        readers.read(tmp_path / "a.xrz")


@pytest.mark.parametrize("name", ["a.xrk", "a.xrz", "a.tdms", "a.erg", "a.vbo"])
@pytest.mark.parametrize("content", [b"", b"x" * 300, zlib.compress(b"<hCNF" * 99), bytes(64)])
def test_what_is_no_such_file_is_refused(tmp_path, name, content):
    (tmp_path / name).write_bytes(content)
    (tmp_path / "a.erg.info").write_text(INFO)
    with pytest.raises(UserError, match=name):
        readers.read(tmp_path / name)


@pytest.mark.parametrize(("name", "package"), [("a.xrk", "libxrk"), ("a.tdms", "nptdms")])
def test_a_missing_package_is_one_line_that_names_the_extra(tmp_path, monkeypatch, name, package):
    monkeypatch.setitem(sys.modules, package, None)
    (tmp_path / name).write_bytes(b"x")
    with pytest.raises(UserError, match=r"pip install .robustness-harness\[racing\]"):
        readers.read(tmp_path / name)


@pytest.mark.skipif(not CASES.is_dir(), reason="the cases of users are not here")
def test_the_case_of_simulink_is_read():
    (table,) = readers.read_tables(CASES / "08-simulink" / "single.mat")
    assert list(table.columns) == ["beta.time", "beta"]
    np.testing.assert_allclose(np.diff(table.columns["beta.time"]), 0.01)


def test_arrays_with_a_time_and_structures_with_time_are_read(tmp_path):
    signals = np.zeros(2, dtype=[("values", "O"), ("label", "O")])
    signals[0], signals[1] = (TIME[:, None], "yaw_rate"), (np.c_[TIME, -TIME], "")
    log = {"time": TIME[:, None], "signals": signals}
    rows, columns = np.vstack([TIME, TIME**2]), np.c_[TIME, 2 * TIME, 3 * TIME]
    scipy.io.savemat(tmp_path / "a.mat", {"beta": rows, "out": columns, "log": log, "map": np.eye(30)})
    (table,) = readers.read_tables(tmp_path / "a.mat")
    expected = {
        "beta.time": TIME, "beta": TIME**2, "out.time": TIME, "out.1": 2 * TIME, "out.2": 3 * TIME, "log.time": TIME,
        "log.signals.yaw_rate": TIME, "log.signals.2.1": TIME, "log.signals.2.2": -TIME,
    }  # fmt: skip
    assert set(table.columns) == set(expected)
    for name, values in expected.items():
        np.testing.assert_array_equal(table.columns[name], values)


def opaque(folder, kind):
    """Write a variable ``x`` that is an object of MATLAB, as version 7 stores it, beside a vector."""

    def element(of, content):
        return struct.pack("<II", of, len(content)) + content + bytes(-len(content) % 8)

    scipy.io.savemat(folder / "a.mat", {"v": TIME})
    name, system, of = (element(1, text) for text in (b"x", b"MCOS", kind.encode()))
    inner = element(6, struct.pack("<II", 13, 0)) + element(5, struct.pack("<ii", 1, 1)) + element(1, b"")
    inner = element(14, inner + element(6, struct.pack("<I", 7)))
    whole = element(14, element(6, struct.pack("<II", 17, 0)) + name + system + of + inner)
    head = (folder / "a.mat").read_bytes()
    (folder / "both.mat").write_bytes(head + whole)
    (folder / "alone.mat").write_bytes(head[:128] + whole)


@pytest.mark.parametrize(
    ("kind", "said"), [("timeseries", r"'time', x\.Time"), ("Simulink.SimulationData.Dataset", r"x\.numElements")]
)
def test_objects_of_matlab_are_named_with_what_to_type(tmp_path, kind, said):
    opaque(tmp_path, kind)
    with pytest.raises(UserError, match=rf"'x' is a MATLAB object \({kind}\); in MATLAB type: .*{said}"):
        readers.read(tmp_path / "alone.mat")
    (table,) = readers.read_tables(tmp_path / "both.mat")
    np.testing.assert_array_equal(table.columns["v"], TIME)
    assert "'x' is a MATLAB object" in table.notes[0]


def test_arrays_without_a_time_are_named(tmp_path):
    scipy.io.savemat(tmp_path / "a.mat", {"m": np.eye(50), "k": 3.0})
    with pytest.raises(UserError, match="'m' is an array of 50×50 whose first row is no time"):
        readers.read(tmp_path / "a.mat")
