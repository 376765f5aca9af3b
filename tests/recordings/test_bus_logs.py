import struct
import time
import tracemalloc
import zlib
from pathlib import Path

import cantools
import numpy as np
import pytest
from asammdf import MDF, Signal

from harness.common.errors import UserError
from harness.recordings import load_recording, readers
from harness.recordings.check.run import check_recording
from harness.recordings.proposal.propose import propose
from harness.recordings.readers import mdf
from harness.recordings.readers._decode import Octets, raw_values
from harness.recordings.readers._frames import Frames
from support import bus_logs

CAN = Path(__file__).parents[3] / "shared" / "can"
J1939, GNSS = CAN / "CSS-Electronics-SAE-J1939-DEMO.dbc", CAN / "gnss.dbc"
real = pytest.mark.skipif(not CAN.is_dir(), reason="real bus logs are absent: ../shared/can")
FORMS = ("blf", "asc", "log", "trc", "mf4")
BUSES = {".log": {"can0": "1", "can1": "2"}, ".mf4": {"0": "1", "1": "2"}}


def signals(path, database, wanted=None):
    """Return stamps and values by signal, the buses named 1 and 2 whatever the form calls them."""
    columns, names = {}, BUSES.get(path.suffix, {})
    for table in readers.read_tables(path, wanted, [str(database)]):
        for name, values in table.columns.items():
            if name != table.clock:
                bus, _, signal = name.partition(".")
                columns[f"{names.get(bus, bus)}.{signal}"] = table.columns[table.clock], values
    return columns


@pytest.fixture(scope="module")
def log(tmp_path_factory):
    folder = tmp_path_factory.mktemp("bus")
    messages = bus_logs.frames()
    database = bus_logs.database(folder)
    return messages, database, {form: bus_logs.write(folder / f"log.{form}", messages) for form in FORMS}


@pytest.mark.parametrize("form", FORMS)
def test_every_form_gives_the_signals_of_the_frames(log, form):
    messages, database, files = log
    read = signals(files[form], database)
    reference = {
        "1.Motion.Speed": ("Motion", "Speed", 0, 0.01, 0.0),
        "2.Motion.Speed": ("Motion", "Speed", 1, 0.01, 0.0),
        "1.Motion.YawRate": ("Motion", "YawRate", 0, 0.0625, -3.0),
        "Long.Count": ("Long", "Count", 0, 1.0, 0.0),
        "Angle.Wheel": ("Angle", "Wheel", 0, 1.0, 0.0),
        "Wide.Behind": ("Wide", "Behind", 0, 0.001, 0.0),
    }
    for name, (message, signal, bus, scale, offset) in reference.items():
        raw = bus_logs.raw_values(messages, bus, message, signal)
        physical = [np.nan if r is None or (signal == "Speed" and r in (65533, 65535)) else r for r in raw]
        expected = np.array([float(r) * scale + offset for r in physical])
        np.testing.assert_array_equal(read[name][1], expected, err_msg=name)
        stamps = read[name][0]
        sent = [m.timestamp for m in messages if m.channel == bus and m.arbitration_id == {"Motion": 256}.get(message)]
        if sent:
            np.testing.assert_allclose(stamps - stamps[0], np.array(sent) - sent[0], atol=1e-6)
    assert np.isnan(read["1.Motion.Speed"][1]).sum() == 4


def test_all_forms_and_decoded_files_agree_to_the_bit(log, tmp_path):
    _, database, files = log
    first = signals(files["blf"], database)
    for form in FORMS[1:]:
        other = signals(files[form], database)
        assert set(other) == set(first)
        for name, (_, values) in first.items():
            np.testing.assert_array_equal(other[name][1], values, err_msg=f"{form} {name}")
    for path in bus_logs.decoded(tmp_path, first):
        columns = {}
        for table in readers.read_tables(path):
            columns |= table.columns
        for name, (_, values) in first.items():
            kept = values[np.isfinite(values)]
            np.testing.assert_array_equal(columns[name][np.isfinite(columns[name])], kept, err_msg=f"{path} {name}")


def test_each_signal_has_the_frames_that_hold_it(log):
    messages, database, files = log
    tables = {t.clock: t for t in readers.read_tables(files["blf"], None, [str(database)])}
    second = tables["2.Motion.time"]
    assert np.isnan(second.columns["2.Motion.Speed"][3])
    assert second.notes[0].startswith("2.Motion.Speed: 1 of 40 frames are too short")
    first = tables["Choice.Which=0.time"].columns["Choice.First"]
    raw = [int.from_bytes(m.data[1:3], "little", signed=True) for m in messages if m.arbitration_id == 259]
    np.testing.assert_array_equal(first, 0.5 * np.array(raw[::2]))
    assert len(tables["Choice.Which=1.time"].columns["Choice.Second"]) == 20


def test_j1939_is_read_from_every_address_and_no_value_is_missing(log):
    read = signals(log[2]["blf"], log[1])
    engine, other = read["EEC1@00.EngineSpeed"][1], read["EEC1@21.EngineSpeed"][1]
    np.testing.assert_array_equal(other, 0.125 * (900 + np.arange(40)))
    assert np.flatnonzero(np.isnan(engine)).tolist() == [5, 6]
    np.testing.assert_array_equal(read["EEC1@00.Mode"][1][:4], [0, 1, np.nan, np.nan])


def test_messages_of_several_frames_are_put_together(tmp_path):
    dbc = """VERSION ""
BU_: E
BO_ 2566848000 VehicleWeight: 20 E
 SG_ Mass : 128|16@1+ (10,0) [0|0] "kg" E
 SG_ Low : 0|8@1+ (1,0) [0|0] "kg" E
BA_DEF_ BO_ "VFrameFormat" ENUM "StandardCAN","ExtendedCAN","StandardCAN_FD","J1939PG";
BA_ "VFrameFormat" BO_ 2566848000 3;
"""
    (tmp_path / "t.dbc").write_text(dbc, encoding="utf-8")
    lines = ["(0.5) can0 18FEEE00#0102030405060708"]
    for k in range(6):
        body = [bytes([10 + k, *range(1, 16), *(100 * k + a).to_bytes(2, "little"), 0, 0, 255]) for a in (0, 1)]
        pieces = [[f"{n + 1:02X}" + b[7 * n : 7 * n + 7].hex() for n in range(3)] for b in body]
        sent = [(f"1CECFF{a:02X}", "20140003FFFEFE00") for a in (0, 1)]
        sent += [(f"1CEBFF{a:02X}", pieces[a][n]) for n in range(3) for a in (0, 1)]  # of two senders in turn
        if k == 2:
            del sent[4]  # a frame of the first sender is lost
        lines += [f"({k + 1}.{n:02}) can0 {name}#{data}" for n, (name, data) in enumerate(sent)]
    (tmp_path / "a.log").write_text("\n".join(lines) + "\n", encoding="utf-8")
    read = signals(tmp_path / "a.log", tmp_path / "t.dbc")
    stamps, mass = read["VehicleWeight@00.Mass"]
    assert mass.tolist() == [1000.0 * k for k in (0, 1, 3, 4, 5)]
    np.testing.assert_allclose(stamps, [1.06, 2.06, 4.06, 5.06, 6.06])
    assert read["VehicleWeight@01.Mass"][1].tolist() == [1000.0 * k + 10 for k in range(6)]
    assert read["VehicleWeight@01.Low"][1].tolist() == [10.0 + k for k in range(6)]
    notes = readers.read_tables(tmp_path / "a.log", None, [str(tmp_path / "t.dbc")])[0].notes
    assert "11 of 15 frames" in notes[0]
    assert "0x18FEEE00" in notes[0]


def test_states_of_a_value_table_stay_numbers(log):
    read = signals(log[2]["blf"], log[1])
    np.testing.assert_array_equal(read["1.Motion.Gear"][1], 5 + np.arange(40) % 3)
    raw = np.array(bus_logs.raw_values(log[0], 0, "Choice", "Level"), dtype=float)
    assert (raw >= 14).any()
    np.testing.assert_array_equal(read["Choice.Level"][1], np.where(raw >= 14, np.nan, raw))


def test_raw_values_are_those_of_cantools_whatever_the_layout():
    rng = np.random.default_rng(0)
    data = rng.integers(0, 256, (50, 64), dtype=np.uint8)
    ids = np.full(50, 1, dtype=np.uint32)
    start = np.arange(50, dtype=np.int64) * 64
    length = np.full(50, 64, dtype=np.uint8)
    octets = Octets(
        Frames(np.arange(50.0), ids, np.zeros(50, np.int16), ("1",), length, start, data.ravel()), np.arange(50)
    )
    for _ in range(300):
        order = rng.choice(["little_endian", "big_endian"])
        size, at = int(rng.integers(1, 65)), int(rng.integers(0, 512))
        conversion = cantools.database.conversion.BaseConversion.factory(is_float=False)
        signal = cantools.database.can.Signal("s", at, size, order, bool(rng.integers(2)), conversion)
        try:
            message = cantools.database.can.Message(1, "m", 64, [signal], strict=True)
        except cantools.database.Error:
            continue
        expected = [message.decode(row.tobytes(), scaling=False)["s"] for row in data]
        assert raw_values(octets, signal).tolist() == expected, (order, size, at)


def test_only_what_is_wanted_is_decoded(log):
    read = signals(log[2]["mf4"], log[1], {"EEC1@00.EngineSpeed", "Long.Count"}.__contains__)
    assert set(read) == {"EEC1@00.EngineSpeed", "Long.Count"}


def test_databases_are_of_a_bus_or_of_all(log):
    _, database, files = log
    read = readers.read_tables(files["blf"], None, [f"2={database}"])
    assert [t.clock for t in read] == ["Motion.time"]
    with pytest.raises(UserError, match=r"^absent.dbc: the database does not exist"):
        readers.read_tables(files["blf"], None, ["absent.dbc"])
    with pytest.raises(UserError, match=r"has no bus '7'.*there are 1, 2"):
        readers.read_tables(files["blf"], None, [f"7={database}"])


def test_databases_that_contradict_each_other_are_pointed_out(log, tmp_path):
    other = tmp_path / "other.dbc"
    other.write_text(Path(log[1]).read_text(encoding="utf-8").replace("(0.0625,-3)", "(0.125,-3)"), encoding="utf-8")
    assert other.read_text(encoding="utf-8") != Path(log[1]).read_text(encoding="utf-8")
    for wanted in (None, lambda name: name == "2.Motion.YawRate"):
        read = readers.read_tables(log[2]["blf"], wanted, [str(log[1]), str(other)])
        (note,) = {n for t in read for n in t.notes if "differently" in n and n.startswith("2.")}
        assert note.startswith("2.Motion")
        assert "other.dbc" in note
    read = readers.read_tables(log[2]["blf"], None, [str(log[1])] * 2)
    assert not [n for t in read for n in t.notes if "differently" in n]


def test_without_a_database_the_identifiers_and_their_rates_are_named(log):
    for path in log[2].values():
        with pytest.raises(UserError, match=r"360 raw frames.*--database FILE.*0x0CF00400 \(10\d/s\)"):
            readers.read_tables(path)


def test_a_wrong_database_says_how_many_frames_it_knows(log, tmp_path):
    wrong = tmp_path / "wrong.dbc"
    wrong.write_text('VERSION ""\nBU_: A\nBO_ 5 Other: 8 A\n SG_ x : 0|8@1+ (1,0) [0|0] "" A\n', encoding="utf-8")
    with pytest.raises(UserError, match=r"none of 360 frames.*0x100 \("):
        readers.read_tables(log[2]["asc"], None, [str(wrong)])
    notes = readers.read_tables(log[2]["asc"], None, [str(log[1])])[0].notes
    assert "320 of 360 frames" in notes[0]
    assert "0x7AB" in notes[0]


def test_candump_has_remote_and_error_frames_and_a_last_line_that_is_cut(log, tmp_path):
    path = tmp_path / "a.log"
    lines = ["(1.000000) can0 100#E803000000000000", "(1.010000) can0 100#R8", "(1.010000) can0 100#R", ""]
    lines += ["(1.020000) can0 20000004#0000000000000000", "(1.030000) can0 104##3" + "00" * 64 + " R", "(1.04"]
    path.write_text("\r\n".join(lines), encoding="utf-8")
    read = signals(path, log[1])
    assert read["Motion.Speed"][1].tolist() == [10.0]
    assert (read["Wide.Behind"][0].tolist(), read["Wide.Behind"][1].tolist()) == ([1.03], [0.0])
    path.write_text("\n".join([*lines[:2], "(1.5) can0 no frame", lines[0]]), encoding="utf-8")
    with pytest.raises(UserError, match="no frame"):
        readers.read_tables(path, None, [str(log[1])])


def test_stamps_relative_to_the_line_before_are_added_up(log, tmp_path):
    lines = log[2]["asc"].read_text(encoding="utf-8").replace("absolute", "relative").split("\n")
    lines[10:10] = [" 0.004000 CAN 1 Status:chip status error active"]
    before = 0
    for i, line in enumerate(lines):
        if line.startswith(" "):
            stamp = round(1e6 * float(line[:9]))
            lines[i] = f"{(stamp - before) / 1e6:9.6f}{line[9:]}"
            before = stamp
    path = tmp_path / "relative.asc"
    path.write_text("\n".join(lines), encoding="utf-8")
    absolute, relative = signals(log[2]["asc"], log[1]), signals(path, log[1])
    for name, (stamps, values) in absolute.items():
        np.testing.assert_array_equal(relative[name][0], stamps, err_msg=name)
        np.testing.assert_array_equal(relative[name][1], values, err_msg=name)


@pytest.mark.parametrize("kind", ["kcd", "sym", "arxml"])
def test_other_databases_give_the_same_signals(log, tmp_path, kind):
    loaded = cantools.database.load_string(bus_logs.DBC, "dbc")
    other = tmp_path / f"bus.{kind}"
    text = {"kcd": loaded.as_kcd_string(), "sym": loaded.as_sym_string(), "arxml": bus_logs.ARXML}[kind]
    other.write_text(text, encoding="utf-8")
    expected, read = signals(log[2]["blf"], log[1]), signals(log[2]["blf"], other)
    names = ("1.Motion.YawRate", "Long.Count", "Angle.Wheel", "Wide.Behind")
    for name in names[: 1 if kind == "arxml" else None]:
        np.testing.assert_array_equal(read[name][1], expected[name][1], err_msg=name)


def test_a_map_is_proposed_with_its_database_and_is_enough(log, tmp_path):
    _, database, files = log
    proposal = propose(files["blf"], [str(database)], tmp_path / "maps")
    assert "km/h" in proposal.text
    assert {clock[0] for clock in proposal.clocks} == {"1.Motion.time"}
    (tmp_path / "maps").mkdir()
    path = tmp_path / "maps" / "log.toml"
    path.write_text(proposal.text, encoding="utf-8")
    recording = load_recording(files["blf"], path)
    assert recording["speed"].attrs["channel"].endswith("Motion.Speed")


def test_an_absent_package_is_one_line_that_names_the_extra(log, monkeypatch):
    monkeypatch.setitem(__import__("sys").modules, "cantools", None)
    with pytest.raises(UserError, match=r"pip install \"robustness-harness\[can\]\"$"):
        readers.read_tables(log[2]["asc"], None, [str(log[1])])


def test_a_database_for_a_file_that_is_no_bus_log_is_refused_and_one_of_a_map_is_not(log, tmp_path):
    path = tmp_path / "a.csv"
    path.write_text("time,Motion.Speed\n" + "".join(f"{0.1 * i},{i}\n" for i in range(50)), encoding="utf-8")
    for read in (propose, lambda path, stated: check_recording(path, databases=stated)):
        with pytest.raises(UserError, match=r"is no bus log.*--database"):
            read(path, [str(log[1])])
    both = {"title": "a", "database": str(log[1]), "time": {"channel": "time", "unit": "s"}}
    both["speed"] = {"channel": "Motion.Speed", "unit": "m/s"}
    assert len(load_recording(path, both)["speed"]) == len(check_recording(path, both).recording["speed"]) == 50
    with MDF(version="4.10") as file:
        file.append([Signal(np.arange(50.0), 0.1 * np.arange(50), name="speed")])
        file.save(tmp_path / "a.mf4")
    assert "no raw frames" in readers.read_tables(tmp_path / "a.mf4", None, [str(log[1])])[0].notes[0]


def test_blocks_that_unpack_into_more_than_they_state_are_refused(log, tmp_path):
    content = bytearray(log[2]["blf"].read_bytes())
    at = content.index(b"LOBJ") + 16
    assert int.from_bytes(content[at : at + 2], "little") == 2
    content[at + 8 : at + 12] = (100).to_bytes(4, "little")
    path = tmp_path / "a.blf"
    path.write_bytes(content)
    with pytest.raises(UserError, match="unpacks into more than the 100 bytes that it states"):
        readers.read_tables(path, None, [str(log[1])])


def test_a_log_that_unpacks_into_too_much_is_refused(log, tmp_path):
    path = tmp_path / "a.blf"
    packed = zlib.compress(bytes(2**27), 9)
    container = struct.pack("<4sHHLL", b"LOBJ", 16, 1, 32 + len(packed), 10) + struct.pack("<H6xL4x", 2, 2**27)
    path.write_bytes(log[2]["blf"].read_bytes()[:144] + container + packed)
    tracemalloc.start()
    with pytest.raises(UserError, match="unpacked"):
        readers.read_tables(path, None, [str(log[1])])
    assert tracemalloc.get_traced_memory()[1] < 2**28 + 2**25
    tracemalloc.stop()


@pytest.mark.parametrize("stated", [2**30, 1000])
def test_packed_blocks_of_an_mdf_file_hold_what_they_state(tmp_path, stated):
    path = tmp_path / "a.mf4"
    with MDF(version="4.10") as file:
        file.append([Signal(np.zeros(100_000), np.arange(1e5), name="speed")])
        file.save(path, compression=1)
    content = bytearray(path.read_bytes())
    at = content.index(b"##DZ") + 32
    content[at : at + 8] = stated.to_bytes(8, "little")
    path.write_bytes(content)
    with pytest.raises(UserError, match=r"unpacked,? has|holds more than the 1000 that it states"):
        readers.read_tables(path)


@pytest.mark.parametrize("version", ["4.10", "3.30"])
def test_a_channel_of_an_mdf_file_lies_within_the_records(tmp_path, version):
    """What lies beyond them would be read from any memory, and that ends the process."""
    path = tmp_path / ("a.mf4" if version == "4.10" else "a.mdf")
    with MDF(version=version) as file:
        file.append([Signal(np.arange(100.0), np.arange(1e2), name="speed")])
        file.save(path)
    assert readers.read_tables(path)[0].columns["speed"][-1] == 99.0
    content = bytearray(path.read_bytes())
    if version == "4.10":  # behind the links: types, bit offset, byte offset
        at = content.index(b"##CN")
        place = at + 24 + 8 * int.from_bytes(content[at + 16 : at + 24], "little") + 4
        content[place : place + 4] = (64).to_bytes(4, "little")
    else:  # behind links, type, names: start offset in bits
        at = content.index(b"CN")
        place = at + 4 + 5 * 4 + 2 + 32 + 128
        content[place : place + 2] = (640).to_bytes(2, "little")
    path.write_bytes(content)
    with pytest.raises(UserError, match="lies beyond the records of its group"):
        readers.read_tables(path)


def test_a_minute_of_a_busy_bus_takes_a_fraction_of_a_second_and_little_memory(log, tmp_path):
    path = bus_logs.long_blf(tmp_path / "long.blf", 300_000)  # a tenth of ten minutes, within a tenth of 5 s and 1 GB
    readers.read_tables(log[2]["blf"], None, [str(log[1])])
    begun = time.process_time()
    (table,) = readers.read_tables(path, None, [str(log[1])])
    assert time.process_time() - begun < 0.5
    assert len(table.columns["Motion.Speed"]) == 300_000
    np.testing.assert_array_equal(table.columns["Motion.time"][[0, -1]], [0.0, 59.9998])
    tracemalloc.start()
    readers.read_tables(path, None, [str(log[1])])
    assert tracemalloc.get_traced_memory()[1] < 1e8
    tracemalloc.stop()


@real
def test_frames_of_several_groups_are_in_the_order_of_their_stamps():
    path = CAN / "2F6913DB_00001089_00000001-63BEF5CD.MF4"
    with MDF(path, process_bus_logging=False) as file:
        frames = mdf._frames(file, str(path))
    assert len(frames.buses) > 2
    assert (np.diff(frames.time) >= 0).all()


@real
def test_the_real_truck_log_is_decoded():
    path = CAN / "11111111_00000012_00000001.MF4"
    tables = {t.clock: t for t in readers.read_tables(path, None, [str(J1939), str(GNSS)])}
    assert len(tables["EEC1.time"].columns["EEC1.EngineSpeed"]) == 12719
    assert tables["EEC1.time"].units == {"EEC1.EngineSpeed": "rpm"}
    assert tables["gnss_imu.time"].columns["gnss_imu.AccelerationX"][:2].tolist() == [-2.0, -1.875]
    proposal = propose(path, [str(J1939), str(GNSS)])
    assert {"heading", "latitude", "longitude"} <= {g.signal for g in proposal.guesses}


@real
@pytest.mark.parametrize("name", ["2F6913DB_00000004_00000001", "2F6913DB_00001089_00000001-63BEF5CD"])
def test_the_other_real_logs_are_read(name):
    tables = readers.read_tables(CAN / f"{name}.MF4", None, [str(GNSS)])
    assert any("gnss_status.FixType" in t.columns for t in tables)


@real
def test_a_real_log_with_the_wrong_databases_is_refused_in_words():
    with pytest.raises(UserError, match=r"none of 9600 frames.*0x09F11202 \(40/s\)"):
        readers.read_tables(CAN / "94C49784_00000005_00000002.MF4", None, [str(J1939), str(GNSS)])
