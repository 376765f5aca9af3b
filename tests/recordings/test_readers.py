import gzip
import os
import subprocess
import sys
import tracemalloc
from pathlib import Path

import asammdf
import h5py
import numpy as np
import pandas as pd
import pyarrow as pa
import pyarrow.parquet as pq
import pytest
import scipy.io

from harness.common import files
from harness.common.errors import UserError
from harness.recordings import readers
from harness.recordings.readers import csv as csv_reader
from harness.recordings.readers import mdf, parquet

COLUMNS = {
    "time": np.arange(50) * 0.01,
    "speed": 10 + np.sin(np.arange(50)),
    "with_hole": np.where(np.arange(50) == 7, np.nan, np.arange(50.0)),
}


def same(read, expected=COLUMNS):
    assert list(read) == list(expected)
    for name, values in expected.items():
        assert read[name].dtype == np.float64
        np.testing.assert_allclose(read[name], values, rtol=1e-15)


@pytest.mark.parametrize("suffix", [".csv", ".csv.gz", ".CSV", ".txt.gz"])
def test_csv_round_trip(tmp_path, suffix):
    path = tmp_path / f"a{suffix}"
    compression = "gzip" if suffix.endswith(".gz") else None
    pd.DataFrame(COLUMNS).to_csv(path, index=False, compression=compression)
    same(readers.read(path))


def test_parquet_round_trip_keeps_numbers_only(tmp_path):
    path = tmp_path / "speed=3.parquet"
    text = {"driver": ["A"] * 50, "brake": [True, False] * 25, "gear": pa.array([1, None] * 25, pa.int64())}
    pq.write_table(pa.table({**COLUMNS, **text}), path)
    read = readers.read(path)
    np.testing.assert_array_equal(read.pop("brake"), [1, 0] * 25)
    np.testing.assert_array_equal(read.pop("gear"), [1, np.nan] * 25)
    same(read)


def test_mat_round_trip_leaves_parameters_out(tmp_path):
    path = tmp_path / "a.mat"
    extra = {
        "mass": 24e3,
        "mode": "Real",
        "gains": np.arange(3.0),
        "matrix": np.eye(50),
        "complex": 1j * np.ones(50),
    }
    scipy.io.savemat(path, {**COLUMNS, **extra})
    same(readers.read(path))


def test_mat_structures_become_dotted_names(tmp_path):
    path = tmp_path / "a.mat"
    scipy.io.savemat(path, {"log": {"t": COLUMNS["time"], "imu": {"r": COLUMNS["speed"]}}})
    same(readers.read(path), {"log.t": COLUMNS["time"], "log.imu.r": COLUMNS["speed"]})


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("# recorded on Monday\n# by somebody\n\nt,v\n0,1\n1,2\n", {"t": [0, 1], "v": [1, 2]}),
        ("# t, v\n0,1\n1,2\n", {"t": [0, 1], "v": [1, 2]}),  # as numpy.savetxt
        ("t;v\n0,5;1,25\n1;2\n", {"t": [0.5, 1], "v": [1.25, 2]}),
        ("t;v\n0;1\n1;2\n1,5;2\n", {"t": [0, 1, 1.5], "v": [1, 2, 2]}),  # the comma comes late
        ("t;v\n0;1,500\n0,5;1,600\n", {"t": [0, 0.5], "v": [1.5, 1.6]}),  # the second time decides for the values
        ("t;v;note\n0.5;1;a, b\n1.5;2;c\n", {"t": [0.5, 1.5], "v": [1, 2]}),
        ("t;date\n0,5;16.09.2024\n1;16.09.2024\n", {"t": [0.5, 1]}),
        ("t,v\n0,1,\n1,2,\n", {"t": [0, 1], "v": [1, 2]}),
        ("t\tv\n0.5\t1\n1\t2\n", {"t": [0.5, 1], "v": [1, 2]}),
        ("t,v\ns,m/s\n0,1\n1,2\n", {"t": [0, 1], "v": [1, 2]}),
        ("t,v,mode\n0,,Real\n1,2,Real\n", {"t": [0, 1], "v": [np.nan, 2]}),
        ('"yaw rate, rad/s",v\n0,1\n1,nan\n', {"yaw rate, rad/s": [0, 1], "v": [1, np.nan]}),
        ("0,1\n1,2\n", {"column_1": [0, 1], "column_2": [1, 2]}),
        ("% some words\n1.5\n2\n", {"column_1": [1.5, 2]}),
        ("\ufefft,v\r\n0,1\r\n1,2\r\n", {"t": [0, 1], "v": [1, 2]}),
    ],
)
def test_csv_dialects(tmp_path, text, expected):
    path = tmp_path / "a.csv"
    path.write_text(text, encoding="utf-8", newline="")
    same(readers.read(path), expected)


@pytest.mark.parametrize(
    ("name", "content", "message"),
    [
        ("a.csv", b"", "is empty"),
        ("a.csv", b"# nothing\n", "is empty"),
        ("a.csv", b"t,v\n", "no row of data"),
        ("a.csv", b"t," + b"v" * 2**18 + b"\n0,1\n", "the first lines are no header of a table: field larger"),
        ("a.csv", b"t,v\n0," + b"1" * 400 + b"\n", "an integer is beyond all floating-point numbers"),
        ("a.csv", b"t,v\n0,1\n1,2,3\n", "line 3"),
        ("a.csv", b"t,v\n0,1\n1,fast\n", "column 'v', row 2 of the data: 'fast' is not a number"),
        ("a.csv", b"t,v\n0,5,1,5\n1,0,2,0\n", "more cells than the 2 of the header; with decimal commas, separate"),
        ("a.csv", b"t\n0,5\n1,5\n", "more cells than the 1 of the header"),
        ("a.csv", b"t;v\n0;1,500\n1;1,600\n", "'1,500' may mean '1.500' or '1500'"),
        ("a.csv", b"t;v\n0;1,500,000\n", "column 'v', row 1 of the data: '1,500,000' means '1500000'"),
        (
            "a.csv",
            b"t;v;w\n0,5;1,5;1.500\n1;2;1.600\n",
            "column 'w', row 1 of the data: '1.500' may mean 1.500 or 1500",
        ),
        ("a.csv", b"t;v\n0.5;0,5\n1.5;1,5\n", "column 'v', row 1 of the data: '0,5' may mean '0.5' or '5'"),
        ("a.csv", b't,v\n0,"1,500"\n', "column 'v', row 1 of the data: '1,500' may mean '1.500' or '1500'"),
        ("a.csv", b"t,v\n0,1_500\n", "'1_500' means '1500'"),
        ("a.csv", b"t,v\n0,1 500\n", "'1 500' means '1500'"),
        ("a.csv", b"t,v\n0,1'500\n", "means '1500'"),
        ("a.csv", "t,v\n0,−5\n1,−6\n".encode(), "column 'v', row 1 of the data: '−5' is not a number"),
        ("a.csv", b"t,t\n0,1\n", "two columns are named 't'"),
        ("a.csv", b"driver\nA\nB\nC\n", "holds no numeric column"),
        ("a.csv", b"\xff\xfet\x00,\x00v\x00\n\x00", "is UTF-16 text; save or export it as UTF-8"),
        ("a.txt.gz", gzip.compress("t;v\n0;1\n".encode("utf-16"), mtime=0), "is UTF-16 text; save or export it"),
        ("a.csv", b"\xffx\x00t,v\n", "UTF-8"),
        ("a.csv.gz", b"t,v\n0,1\n", "damaged"),
        ("a.csv.gz", gzip.compress(b"t,v\n" + b"0,1\n" * 999, mtime=0)[:-12], "damaged"),
        ("a.mat", b"no matlab", "is damaged or no MATLAB file"),
        ("a.mat", bytes(300), "is damaged or no MATLAB file: "),
        ("a.mat", b" " * 300, "does not begin as one of version"),
        ("a.mat", b"MATLAB 7.3 MAT-file".ljust(124) + b"\x00\x02IM", "is damaged or no MATLAB file"),
        ("a.parquet", b"PAR1", "is damaged or no Parquet file"),
        ("a.mf4", b"no measured data" * 9, "is damaged or no MDF file"),
        ("a.xlsx", b"", "no reader for this suffix; known are .asc, .bag, .blf, .csv, "),
    ],
)
def test_bad_files_are_refused_by_name(tmp_path, name, content, message):
    path = tmp_path / name
    path.write_bytes(content)
    with pytest.raises(UserError) as error:
        readers.read(path)
    assert str(error.value).startswith(str(path))
    assert message in str(error.value)


@pytest.mark.parametrize("name", ["a.csv", "a.csv.gz", "a.txt"])
@pytest.mark.parametrize(
    "text", ["time,v\n0,1\n1,2\n", "0,1\n1,2\n", "# made by x\n0,1\n1,2\n", "time;v\n0,5;1,5\n1,5;2,5\n"]
)
def test_a_byte_order_mark_is_no_part_of_a_recording(tmp_path, name, text):
    found = []
    for encoding in ("utf-8", "utf-8-sig"):
        content = text.encode(encoding)
        path = tmp_path / encoding / name
        path.parent.mkdir()
        path.write_bytes(gzip.compress(content) if name.endswith(".gz") else content)
        found.append(readers.read(path))
    plain, marked = found
    assert list(plain) == list(marked)
    for column in plain:
        np.testing.assert_array_equal(marked[column], plain[column])


def test_absent_file(tmp_path):
    with pytest.raises(UserError, match=r"nowhere\.csv: the recording does not exist"):
        readers.read(tmp_path / "nowhere.csv")


def test_folder_with_one_signal_per_file(tmp_path):
    for name, values in COLUMNS.items():
        with gzip.open(tmp_path / f"{name}.txt.gz", "wt") as file:
            np.savetxt(file, values)
    (tmp_path / "LICENSE").write_text("not data")
    pd.DataFrame(COLUMNS).to_csv(tmp_path / "another.csv")
    same(dict(sorted(readers.read(tmp_path).items(), reverse=True)), dict(sorted(COLUMNS.items(), reverse=True)))


def test_folder_without_signals_is_refused(tmp_path):
    (tmp_path / "folder.csv").mkdir()
    with pytest.raises(UserError, match=r"folder\.csv: the recording is a folder without files of one column"):
        readers.read(tmp_path / "folder.csv")
    for suffix in ("txt", "csv"):
        (tmp_path / f"speed.{suffix}").write_text("1\n2\n")
    with pytest.raises(UserError, match="two files are named 'speed'"):
        readers.read(tmp_path)


def test_csv_units_below_the_header_are_kept(tmp_path):
    path = tmp_path / "a.csv"
    path.write_text("t,v,mode\n[s],[km/h],\n0,1,a\n1,2,b\n")
    assert readers.read_tables(path)[0].units == {"t": "s", "v": "km/h"}


def test_mat_version_73(tmp_path):
    path = tmp_path / "a.mat"
    with h5py.File(path, "w", userblock_size=512) as file:
        for name, values in COLUMNS.items():
            file[f"log/{name}"] = values[None, :]  # as MATLAB writes a row
        file["log/mass"] = np.array([[24e3]])
        file["log/mode"] = np.array([[82], [101]], dtype=np.uint16)
        file["log/mode"].attrs["MATLAB_class"] = np.bytes_("char")
        file["matrix"] = np.eye(3)
        file["#refs#/a"] = np.arange(50.0)
    with open(path, "r+b") as file:
        file.write(b"MATLAB 7.3 MAT-file".ljust(124) + b"\x00\x02IM")
    same(dict(sorted(readers.read(path).items())), {f"log.{k}": v for k, v in sorted(COLUMNS.items())})


def test_mat_signals_of_several_rates_are_separate_tables(tmp_path):
    path = tmp_path / "a.mat"
    scipy.io.savemat(path, {**COLUMNS, "gps": {"t": np.arange(5) * 0.1, "x": np.arange(5.0)}})
    fast, slow = readers.read_tables(path)
    assert set(fast.columns) == set(COLUMNS)
    assert set(slow.columns) == {"gps.t", "gps.x"}


def test_mdf_groups_keep_their_clocks_units_and_invalid_samples(tmp_path):
    path = tmp_path / "a.mf4"
    fast, slow = np.arange(100) * 0.01, np.arange(20) * 0.05
    speed = asammdf.Signal(3.6 * fast, fast, name="v", unit="km/h", invalidation_bits=fast == fast[7])
    with asammdf.MDF(version="4.10") as file:
        file.append([asammdf.Signal(np.sin(fast), fast, name="yaw", unit="deg/s"), speed], acq_name="can")
        file.append([asammdf.Signal(2 * slow, slow, name="v", unit="m/s")], acq_name="gps")
        file.save(path)
    can, gps = readers.read_tables(path)
    assert can.clock == "can.time"
    assert can.units == {"yaw": "deg/s", "can.v": "km/h"}
    np.testing.assert_allclose(can.columns["can.time"], fast)
    np.testing.assert_array_equal(np.isnan(can.columns["can.v"]), fast == fast[7])
    np.testing.assert_allclose(gps.columns["gps.v"], 2 * slow)


@pytest.mark.parametrize("version", ["3.30", "4.10"])
def test_an_mdf_file_whose_groups_form_a_circle_is_damaged(tmp_path, version):
    """asammdf follows such a list for ever."""
    path = tmp_path / f"circle.{'mdf' if version < '4' else 'mf4'}"
    with asammdf.MDF(version=version) as made:
        for name in ("a", "b"):
            made.append([asammdf.Signal(np.arange(3.0), np.arange(3.0), name=name)])
        path = Path(made.save(path))
    content = bytearray(path.read_bytes())
    first, width, behind = (68, 4, 4) if version < "4" else (88, 8, 24)
    group = int.from_bytes(content[first : first + width], "little")
    content[group + behind : group + behind + width] = group.to_bytes(width, "little")
    assert len(readers.read_tables(path)) == 2
    path.write_bytes(content)
    with pytest.raises(UserError, match="damaged or no MDF file: the list of its groups leads back"):
        readers.read_tables(path)


def test_an_mdf_group_that_says_it_has_no_samples_is_left_out(tmp_path):
    """Where its data are there all the same, asammdf reads nothing of them for ever."""
    with asammdf.MDF(version="4.10") as made:
        for name in ("a", "b"):
            made.append([asammdf.Signal(np.arange(3.0), np.arange(3.0), name=name)])
        path = Path(made.save(tmp_path / "empty.mf4"))
    with asammdf.MDF(path) as file:
        count = file.groups[0].channel_group.address + 24 + 6 * 8 + 8  # head, links, number of the record
    content = bytearray(path.read_bytes())
    assert int.from_bytes(content[count : count + 8], "little") == 3
    content[count : count + 8] = bytes(8)
    path.write_bytes(content)
    (table,) = readers.read_tables(path)
    assert "b" in table.columns


@pytest.mark.skipif(not hasattr(os, "mkfifo"), reason="no pipes that are files")
def test_a_pipe_or_a_device_is_not_read(tmp_path):
    """The first would be waited for, the second fill the memory."""
    os.mkfifo(tmp_path / "a.csv")
    (tmp_path / "b.csv").symlink_to("/dev/zero")
    for name in ("a.csv", "b.csv"):
        with pytest.raises(UserError, match="no file but a pipe or a device"):
            readers.read(tmp_path / name)


@pytest.mark.parametrize("size", [100, 700])
def test_a_damaged_mdf_file_leaves_nothing_to_be_closed_in_vain(tmp_path, size):
    mdf = pytest.importorskip("asammdf")
    whole = tmp_path / "whole.mf4"
    with mdf.MDF(version="4.10") as file:
        file.append([mdf.Signal(np.arange(9.0), np.arange(9.0), name="v")])
        file.save(whole)
    (tmp_path / "a.mf4").write_bytes(whole.read_bytes()[:size])
    code = f"from harness.recordings import readers\nreaders.read({str(tmp_path / 'a.mf4')!r})"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=False)
    assert "is damaged or no MDF file" in done.stderr
    assert "Exception ignored" not in done.stderr


LINES = b"time,speed\n" + b"0,1\n" * 9


@pytest.mark.parametrize(
    ("name", "content", "said"),
    [
        ("a.csv", LINES + b"1" * 2**22, "a line has "),
        ("a.csv", b"1" * 2**22, "a line has "),
        ("a.csv", b"t;v\n1,500;1,500\n" + b"1" * 2**22, "a line has "),
        ("a.txt", bytes(2**22), "a line has "),
        ("a.csv.gz", gzip.compress(bytes(2**24), mtime=0), "a line has "),
        ("a.csv.gz", gzip.compress(LINES + b"0,1\n" * 17 * 2**20, mtime=0), "the table, unpacked, has "),
        ("a.csv", b",".join(b"c%d" % n for n in range(10_001)) + b"\n", "the table has 10,001 columns or more"),
    ],
)
def test_what_no_recording_is_as_large_as_is_refused_at_a_bounded_look(tmp_path, name, content, said):
    (tmp_path / name).write_bytes(content)
    tracemalloc.start()
    with pytest.raises(UserError) as error:
        readers.read(tmp_path / name)
    assert tracemalloc.get_traced_memory()[1] < 400e6
    tracemalloc.stop()
    assert str(error.value).startswith(f"{tmp_path / name}: {said}")
    assert "are read; if it is a recording, add --no-limits" in str(error.value)


def test_a_parquet_file_that_unpacks_to_more_than_any_recording_is_refused(tmp_path):
    with pq.ParquetWriter(tmp_path / "a.parquet", pa.schema([("v", pa.float64())])) as file:
        for _ in range(11):
            file.write_table(pa.table({"v": pa.array(np.zeros(10**6))}))
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(parquet, "MOST_BYTES", 10**7)
        with pytest.raises(UserError, match=r"the table has 88,000,000 bytes or more"):
            readers.read(tmp_path / "a.parquet")


@pytest.mark.parametrize(("limit", "says"), [("MOST_BYTES", "unpacked, has 48 bytes"), ("MOST_COLUMNS", "2 channels")])
def test_an_mdf_file_that_is_larger_than_any_recording_is_refused(tmp_path, monkeypatch, limit, says):
    with asammdf.MDF(version="4.10") as made:
        made.append([asammdf.Signal(np.arange(3.0), np.arange(3.0), name="a")])
        path = Path(made.save(tmp_path / "a.mf4"))
    monkeypatch.setattr(mdf, limit, 1)
    with pytest.raises(UserError, match=f"{says} or more, at most 1 are read; if it is a recording, add --no-limits"):
        readers.read_tables(path)
    monkeypatch.setattr(files, "LIMITED", [False])
    assert len(readers.read_tables(path)) == 1


def test_limits_can_be_lifted(tmp_path, monkeypatch):
    monkeypatch.setattr(files, "LIMITED", [False])
    (tmp_path / "a.csv").write_bytes(b",".join(b"c%d" % n for n in range(10_001)) + b"\n" + b",".join([b"1"] * 10_001))
    assert len(readers.read(tmp_path / "a.csv")) == 10_001


def test_pieces_of_a_table_are_the_table(tmp_path, monkeypatch):
    """Text, blanks and numbers are judged over the whole column, wherever it is cut."""
    rows = "".join(f"{i},{'' if i % 3 else i},A,{i / 7!r}\n" for i in range(20))
    (tmp_path / "a.csv").write_text("t,v,driver,w\n" + rows)
    (tmp_path / "b.csv").write_text("t,v\n" + "".join(f"{i},{i}\n" for i in range(9)) + "9,fast\n10,1\n")
    whole = readers.read(tmp_path / "a.csv")
    monkeypatch.setattr(csv_reader, "_AT_ONCE", 4)
    same(readers.read(tmp_path / "a.csv"), whole)
    assert list(whole) == ["t", "v", "w"]
    with pytest.raises(UserError, match="column 'v', row 10 of the data: 'fast' is not a number"):
        readers.read(tmp_path / "b.csv")


@pytest.mark.parametrize("at_once", [3, 100])
def test_columns_that_nobody_wants_say_at_most_where_they_are_blank(tmp_path, monkeypatch, at_once):
    monkeypatch.setattr(csv_reader, "_AT_ONCE", at_once)
    (tmp_path / "a.csv").write_text(
        "t,v,whole,blank\n" + "".join(f"{i},{i},7,{'' if i == 8 else 7}\n" for i in range(9))
    )
    (table,) = readers.read_tables(tmp_path / "a.csv", {"t", "v"}.__contains__)
    assert list(table.columns) == ["t", "v", "blank"]
    np.testing.assert_array_equal(table.columns["blank"], [1.0] * 8 + [np.nan])
    (table,) = readers.read_tables(tmp_path / "a.csv", {"x"}.__contains__)
    assert list(table.columns) == ["t", "v", "whole", "blank"]  # for an error that lists them


def test_missing_asammdf_is_one_clear_error(tmp_path, monkeypatch):
    monkeypatch.setitem(sys.modules, "asammdf", None)
    (tmp_path / "a.mf4").write_bytes(b"x")
    with pytest.raises(UserError, match=r"pip install .robustness-harness\[mdf\]"):
        readers.read(tmp_path / "a.mf4")


def test_a_header_of_a_windows_program_is_read(tmp_path):
    path = tmp_path / "lap.csv"
    path.write_bytes("t;Gierrate;a_y\ns;°/s;m/s²\n0,0;1,5;2,5\n0,1;1,25;2,75\n".encode("cp1252"))
    (table,) = readers.read_tables(path)
    assert table.units == {"t": "s", "Gierrate": "°/s", "a_y": "m/s²"}
    assert table.columns["Gierrate"].tolist() == [1.5, 1.25]
    path.write_bytes(b"t,r\n0,1\n1,\xb02\n")  # in the data it is damage
    with pytest.raises(UserError, match="not a number"):
        readers.read_tables(path)
