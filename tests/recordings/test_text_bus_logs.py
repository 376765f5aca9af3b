"""Text logs of a bus: the frames are those that python-can reads, line by line."""

import can
import numpy as np
import pytest

from harness.common.errors import UserError
from harness.recordings import readers
from harness.recordings.readers import _text_frames, asc, candump, trc
from support import bus_logs


@pytest.fixture(scope="module")
def log(tmp_path_factory):
    """Return the frames, their database and a file of them in each form."""
    folder = tmp_path_factory.mktemp("bus")
    messages = bus_logs.frames()
    files = {form: bus_logs.write(folder / f"log.{form}", messages) for form in ("asc", "log", "trc")}
    return messages, bus_logs.database(folder), files


def test_a_damaged_line_is_named_and_one_that_was_cut_is_left_out(log, tmp_path):
    for form, old in (("asc", " 257 "), ("log", "101#FF"), ("trc", "0101 Rx -  8    FF")):
        text = log[2][form].read_text(encoding="utf-8").replace("  101   ", " 257   ")
        row = next(i for i, line in enumerate(text.split("\n")) if old in line)
        path = tmp_path / f"a.{form}"
        path.write_text(text.replace(old, old.replace("FF", "FG").replace("257", "2z7"), 1), encoding="utf-8")
        with pytest.raises(UserError, match=rf"line {row + 1} is no frame"):
            readers.read_tables(path, None, [str(log[1])])


@pytest.mark.parametrize("form", ["asc", "trc"])
def test_a_last_line_that_was_cut_is_left_out(log, tmp_path, form):
    path = tmp_path / f"a.{form}"
    text = log[2][form].read_text(encoding="utf-8").replace("End TriggerBlock\n", "")
    read = {"asc": asc, "trc": trc}[form].frames
    for cut, lost in ((0, 0), (1, 0), (2, 1), (32, 1)):
        path.write_text(text[: len(text) - cut], encoding="utf-8")
        assert len(read(str(path)).time) == 360 - lost


ODD = {
    "asc": "// a comment\n\n{t}000 2  Statistic: D 10 R 0 XD 0 XR 0 E 0 O 0 B 1.5%\n"
    "{t}001 1  102             Tx   d 4 aB cd 0E f0  Length = 231910 BitCount = 118 ID = 258\n"
    "{t}002 1  102             Rx   r\n{t}003 1  ErrorFrame\n{t}004\t2 100 TxRq d 0\n"
    "{t}005 CANFD   2 Rx 104 Wide 1 0 9 12 01 02 03 04 05 06 07 08 09 0a 0b 0c 0 0\n"
    "{t}006 CANFD   2 Tx ErrorFrame 0 0 0 0\n{t}007 1  J1939TP FEE3p 6 0 0 - Rx d 12 01 02\n"
    "{t}008 1  7FF  Rx d 8 01 02 03 04 05 06 07 08  77 88\n",
    "trc": "; a comment\n\n 7 {t}.125 ST  1      - Rx -  5    00 00 00 08 00\n 8 {t}.25 RR 1 0100 Rx - 8\n"
    "123456 {t}.5 FB 2 18FF1234 Tx - 9  01 02 03 04 05 06 07 08 09 0a 0b 0c\n9 {t}.75 DT 1 0102 Rx - 0\n",
}


@pytest.mark.parametrize("shapes", [64, 0])
@pytest.mark.parametrize("form", ["asc", "trc"])
def test_text_logs_are_what_python_can_reads(log, tmp_path, monkeypatch, form, shapes):
    monkeypatch.setattr(_text_frames, "_SHAPES", shapes)
    path = tmp_path / f"a.{form}"
    text = log[2][form].read_text(encoding="utf-8").replace("End TriggerBlock\n", "")
    path.write_text(text + "".join(ODD[form].replace("{t}", f"{7 + i}.") for i in range(3)).replace("..", "."), "utf-8")
    same_frames(path)


@pytest.mark.parametrize("version", ["1.0", "1.1", "1.3"])
def test_older_versions_of_trc_are_read(tmp_path, version):
    path = tmp_path / "a.trc"
    head = f";$FILEVERSION={version}\n;$STARTTIME=44087.51851\n;  a note\n" if version != "1.0" else "; PCAN\n"
    middle = {"1.0": "", "1.1": "  Rx  ", "1.3": " 2 Rx  "}[version]
    minus = " - " if version == "1.3" else ""
    lines = [
        f"{i:6}) {i * 10.5:9.1f} {middle} {0x100 + i:04X} {minus} 8 01 02 03 04 05 06 07 {i:02X}" for i in range(120)
    ]
    lines += [f" 121) 1300.0 {middle} 18FF0102 {minus} 2 aB 09", f" 122) 1301.0 {middle} 0101 {minus} 3 RTR"]
    lines += [
        " 123) 1302.0  FFFFFFFF 4 00 00 00 08" if version == "1.0" else " 123) 1302.0 1 Error 0008 - 4 00 00 00 08"
    ]
    path.write_text(head + "\n".join(lines) + "\n", encoding="utf-8")
    same_frames(path)


def test_decimal_asc_logs_are_read(tmp_path):
    path = tmp_path / "a.asc"
    lines = [f"{i / 7:.6f} 1  {i}x Rx d 3 {i} 255 0 Length = 12" for i in range(200)]
    path.write_text(
        "base dec timestamps absolute\ninternal events logged\n" + "\n".join(lines) + "\n", encoding="utf-8"
    )
    same_frames(path)


def same_frames(path):
    """Check the frames of a file against those of python-can."""
    frames = (asc if path.suffix == ".asc" else trc).frames(str(path))
    with (can.ASCReader if path.suffix == ".asc" else can.TRCReader)(path) as reader:
        messages = [m for m in reader if not (m.is_error_frame or m.is_remote_frame)]
    assert len(frames.time) == len(messages) > 100
    assert frames.time.tolist() == [m.timestamp for m in messages]
    assert frames.identifier.tolist() == [m.arbitration_id | m.is_extended_id << 31 for m in messages]
    names = [str(m.channel + (path.suffix == ".asc")) for m in messages]
    assert [frames.buses[i] for i in frames.bus] == names
    data = [frames.payload[s : s + n].tobytes() for s, n in zip(frames.start, frames.length, strict=True)]
    assert data == [bytes(m.data) for m in messages]


def test_what_candump_prints_is_read_as_its_log(log, tmp_path):
    lines = [" (1.5)  can0  100   [8]  remote request"]
    for line in log[2]["log"].read_text(encoding="utf-8").splitlines():
        stamp, bus, frame, *_ = line.split()
        name, _, data = frame.partition("#")
        data = bytes.fromhex(data[2:] if data.startswith("#") else data)
        lines.append(f" {stamp}  {bus}  {name}   [{len(data):02}]  {data.hex(' ').upper()}   '........'")
    path = tmp_path / "a.log"
    path.write_text("\n".join([*lines, " (1.5)  can0  100   [8]  00 0"]), encoding="utf-8")
    printed, logged = candump.frames(str(path)), candump.frames(str(log[2]["log"]))
    for name in ("time", "identifier", "bus", "length", "payload"):
        np.testing.assert_array_equal(getattr(printed, name), getattr(logged, name), err_msg=name)
    path.write_text("\n".join([*lines, " (1.5)  can0  100   [8]  00 0", ""]), encoding="utf-8")
    with pytest.raises(ValueError, match=f"line {len(lines) + 1} is no frame"):
        candump.frames(str(path))


@pytest.mark.parametrize("screen", [False, True])
def test_stamps_of_candump_since_the_first_frame_or_the_one_before_are_told_apart(tmp_path, screen):
    micros = np.cumsum(np.random.default_rng(0).integers(100, 4000, 400)) - 100
    micros -= micros[0]
    body = "  can0  123   [2]  0A 0B" if screen else " can0 123#0A0B"
    remote = "  can0  100   [8]  remote request" if screen else " can0 100#R8"

    def written(stamps):
        lines = [f"({s // 1000000:03}.{s % 1000000:06}){remote if i == 7 else body}" for i, s in enumerate(stamps)]
        (tmp_path / "a.log").write_text("\n".join(lines) + "\n", encoding="utf-8")
        return str(tmp_path / "a.log")

    true = np.delete(micros, 7) / 1e6
    between = np.diff(micros, prepend=0)
    np.testing.assert_array_equal(candump.frames(written(micros)).time, true)
    np.testing.assert_array_equal(candump.frames(written(between)).time, true)
    for stamps in (micros[:8], [0, *[10000] * 399], [0, *range(1, 9), 3 * 10**9]):
        with pytest.raises(UserError, match=r"-t z.*-t d"):
            candump.frames(written(stamps))


@pytest.mark.parametrize(
    ("form", "good", "broken"),
    [
        ("asc", "d 8 E8 03", "d 8 E8 .3"),
        ("asc", "d 8 E8 03", "d 8 03"),
        ("asc", "d 4 00 00 00 00", "d 4 00 00 00 00 01"),
        ("asc", "f 64 66 A8", "f 64 66A8"),
        ("asc", " 0 0 f 64 66 ", " 0 0 f 64 "),
        ("trc", "8    E8 03", "E8 03"),
        ("trc", "Rx -  8    E8", "RxE-  8    E8"),
        ("trc", "8    E8 03", "8    E8 3"),
        ("log", "E803", "E80"),
    ],
)
def test_a_frame_that_lost_or_gained_a_digit_is_refused(log, tmp_path, form, good, broken):
    text = log[2][form].read_text(encoding="utf-8")
    assert good in text
    path = tmp_path / f"a.{form}"
    path.write_text(text.replace(good, broken, 1), encoding="utf-8")
    with pytest.raises(ValueError, match=r"line \d+ is no frame"):
        {"asc": asc, "trc": trc, "log": candump}[form].frames(str(path))


def test_a_classic_frame_may_have_any_code_from_8_on(tmp_path):
    path = tmp_path / "a.asc"
    path.write_text("0.1 1 100 Rx d f 01 02 03 04 05 06 07 08  Length = 231910\n", encoding="utf-8")
    assert asc.frames(str(path)).length.tolist() == [8]
