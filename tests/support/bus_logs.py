"""One list of frames of two buses, its database, and the same frames in every form that a logger writes."""

from __future__ import annotations

import struct
import zlib
from pathlib import Path

import can
import cantools
import numpy as np
import pandas as pd
from asammdf import MDF, Signal

DBC = """VERSION ""
NS_ :
BS_:
BU_: ECU
BO_ 256 Motion: 8 ECU
 SG_ Speed : 0|16@1+ (0.01,0) [0|655.32] "km/h" ECU
 SG_ YawRate : 23|13@0- (0.0625,-3) [0|0] "deg/s" ECU
 SG_ Gear : 40|4@1+ (1,0) [0|15] "" ECU
BO_ 257 Long: 8 ECU
 SG_ Count : 0|64@1+ (1,0) [0|0] "ns" ECU
BO_ 258 Angle: 4 ECU
 SG_ Wheel : 0|32@1- (1,0) [0|0] "rad" ECU
BO_ 259 Choice: 4 ECU
 SG_ Which M : 0|8@1+ (1,0) [0|0] "" ECU
 SG_ First m0 : 8|16@1- (0.5,0) [0|0] "m" ECU
 SG_ Level : 24|4@1+ (1,0) [0|15] "" ECU
 SG_ Second m1 : 8|16@1+ (1,0) [0|0] "m/s" ECU
BO_ 260 Wide: 64 ECU
 SG_ Behind : 400|24@1- (0.001,0) [0|0] "m/s^2" ECU
BO_ 2364540158 EEC1: 8 ECU
 SG_ EngineSpeed : 24|16@1+ (0.125,0) [0|8031.875] "rpm" ECU
 SG_ Mode : 0|2@1+ (1,0) [0|3] "" ECU
BA_DEF_ BO_ "VFrameFormat" ENUM "StandardCAN","ExtendedCAN","StandardCAN_FD","J1939PG";
BA_DEF_DEF_ "VFrameFormat" "StandardCAN";
BA_ "VFrameFormat" BO_ 2364540158 3;
SIG_VALTYPE_ 258 Wheel : 1;
VAL_ 256 Speed 65533 "Init" 65535 "SNA" ;
VAL_ 256 Gear 5 "P" 6 "R" 7 "N" 15 "SNA" ;
VAL_ 259 Level 14 "Init" 15 "Error" ;
"""

ARXML = """<?xml version="1.0" encoding="UTF-8"?>
<AUTOSAR xmlns="http://autosar.org/schema/r4.0"><AR-PACKAGES><AR-PACKAGE><SHORT-NAME>P</SHORT-NAME><ELEMENTS>
<CAN-CLUSTER><SHORT-NAME>Bus</SHORT-NAME><CAN-CLUSTER-VARIANTS><CAN-CLUSTER-CONDITIONAL><PHYSICAL-CHANNELS>
<CAN-PHYSICAL-CHANNEL><SHORT-NAME>C</SHORT-NAME><FRAME-TRIGGERINGS><CAN-FRAME-TRIGGERING><SHORT-NAME>T</SHORT-NAME>
<FRAME-REF DEST="CAN-FRAME">/P/Motion</FRAME-REF><CAN-ADDRESSING-MODE>STANDARD</CAN-ADDRESSING-MODE>
<IDENTIFIER>256</IDENTIFIER></CAN-FRAME-TRIGGERING></FRAME-TRIGGERINGS></CAN-PHYSICAL-CHANNEL></PHYSICAL-CHANNELS>
</CAN-CLUSTER-CONDITIONAL></CAN-CLUSTER-VARIANTS></CAN-CLUSTER>
<CAN-FRAME><SHORT-NAME>Motion</SHORT-NAME><FRAME-LENGTH>8</FRAME-LENGTH><PDU-TO-FRAME-MAPPINGS><PDU-TO-FRAME-MAPPING>
<SHORT-NAME>M</SHORT-NAME><PACKING-BYTE-ORDER>MOST-SIGNIFICANT-BYTE-LAST</PACKING-BYTE-ORDER>
<PDU-REF DEST="I-SIGNAL-I-PDU">/P/Pdu</PDU-REF><START-POSITION>0</START-POSITION></PDU-TO-FRAME-MAPPING>
</PDU-TO-FRAME-MAPPINGS></CAN-FRAME>
<I-SIGNAL-I-PDU><SHORT-NAME>Pdu</SHORT-NAME><LENGTH>8</LENGTH><I-SIGNAL-TO-PDU-MAPPINGS><I-SIGNAL-TO-I-PDU-MAPPING>
<SHORT-NAME>S</SHORT-NAME><I-SIGNAL-REF DEST="I-SIGNAL">/P/YawRate</I-SIGNAL-REF>
<PACKING-BYTE-ORDER>MOST-SIGNIFICANT-BYTE-FIRST</PACKING-BYTE-ORDER><START-POSITION>23</START-POSITION>
</I-SIGNAL-TO-I-PDU-MAPPING></I-SIGNAL-TO-PDU-MAPPINGS></I-SIGNAL-I-PDU>
<I-SIGNAL><SHORT-NAME>YawRate</SHORT-NAME><LENGTH>13</LENGTH><NETWORK-REPRESENTATION-PROPS>
<SW-DATA-DEF-PROPS-VARIANTS><SW-DATA-DEF-PROPS-CONDITIONAL>
<BASE-TYPE-REF DEST="SW-BASE-TYPE">/P/SInt</BASE-TYPE-REF></SW-DATA-DEF-PROPS-CONDITIONAL></SW-DATA-DEF-PROPS-VARIANTS>
</NETWORK-REPRESENTATION-PROPS><SYSTEM-SIGNAL-REF DEST="SYSTEM-SIGNAL">/P/Sys</SYSTEM-SIGNAL-REF></I-SIGNAL>
<SW-BASE-TYPE><SHORT-NAME>SInt</SHORT-NAME><BASE-TYPE-ENCODING>2C</BASE-TYPE-ENCODING></SW-BASE-TYPE>
<SYSTEM-SIGNAL><SHORT-NAME>Sys</SHORT-NAME><PHYSICAL-PROPS><SW-DATA-DEF-PROPS-VARIANTS><SW-DATA-DEF-PROPS-CONDITIONAL>
<COMPU-METHOD-REF DEST="COMPU-METHOD">/P/Compu</COMPU-METHOD-REF><UNIT-REF DEST="UNIT">/P/Unit</UNIT-REF>
</SW-DATA-DEF-PROPS-CONDITIONAL></SW-DATA-DEF-PROPS-VARIANTS></PHYSICAL-PROPS></SYSTEM-SIGNAL>
<COMPU-METHOD><SHORT-NAME>Compu</SHORT-NAME><CATEGORY>LINEAR</CATEGORY><COMPU-INTERNAL-TO-PHYS><COMPU-SCALES>
<COMPU-SCALE><COMPU-RATIONAL-COEFFS><COMPU-NUMERATOR><V>-3</V><V>0.0625</V></COMPU-NUMERATOR>
<COMPU-DENOMINATOR><V>1</V></COMPU-DENOMINATOR></COMPU-RATIONAL-COEFFS></COMPU-SCALE></COMPU-SCALES>
</COMPU-INTERNAL-TO-PHYS></COMPU-METHOD>
<UNIT><SHORT-NAME>Unit</SHORT-NAME><DISPLAY-NAME>deg/s</DISPLAY-NAME></UNIT>
</ELEMENTS></AR-PACKAGE></AR-PACKAGES></AUTOSAR>
"""


def database(folder: Path) -> Path:
    """Write the database and return its path."""
    path = folder / "bus.dbc"
    path.write_text(DBC, encoding="utf-8")
    return path


def frames(count: int = 40) -> list[can.Message]:
    """Return the frames, on buses 0 and 1, each message every 10 ms."""
    rng = np.random.default_rng(1)
    messages: list[can.Message] = []

    def send(i: int, place: int, identifier: int, data: bytes, bus: int = 0, **more: bool) -> None:
        stamp = 1_600_000_000 + i * 0.01 + place * 0.001
        messages.append(
            can.Message(
                stamp, identifier, is_extended_id=identifier > 0x7FF, data=data, channel=bus, is_rx=True, **more
            )
        )

    for i in range(count):
        speed = (65535, 65533)[i % 2] if 10 <= i < 14 else 1000 + i
        send(i, 0, 256, speed.to_bytes(2, "little") + rng.bytes(3) + bytes([5 + i % 3, 0, 0]))
        send(i, 1, 257, (2**64 - 1 - i).to_bytes(8, "little"))
        send(i, 2, 258, np.float32(np.sin(i)).tobytes())
        send(i, 3, 259, bytes([i % 2]) + rng.bytes(3))
        send(i, 4, 260, rng.bytes(64), is_fd=True)
        engine = 0xFFFF if i == 5 else 0xFE12 if i == 6 else 800 + i
        send(i, 5, 0x0CF00400, bytes([i % 4, 0, 0]) + engine.to_bytes(2, "little") + bytes(3))
        send(i, 6, 0x18F00421, bytes([0, 0, 0]) + (900 + i).to_bytes(2, "little") + bytes(3))
        send(i, 7, 256, rng.bytes(8) if i != 3 else rng.bytes(1), bus=1)
        send(i, 8, 0x7AB, rng.bytes(2))
    return messages


def write(path: Path, messages: list[can.Message]) -> Path:
    """Write frames with python-can in the form that the suffix says."""
    logger = can.Logger(path)
    for message in messages:
        if not message.is_fd or path.suffix != ".trc":
            logger.on_message_received(message)
    logger.stop()
    if path.suffix == ".trc":  # whose writer leaves out CAN FD
        wide = [m for m in messages if m.is_fd]
        lines = [
            f"{i + 1:7} {1e3 * (m.timestamp - messages[0].timestamp):13.3f} FD {m.channel + 1:2} {m.arbitration_id:8X} "
            f"Rx - 15    {' '.join(f'{octet:02X}' for octet in m.data)}\n"
            for i, m in enumerate(wide)
        ]
        path.write_text(path.read_text(encoding="utf-8") + "".join(lines), encoding="utf-8")
    return path


def long_blf(path: Path, count: int) -> Path:
    """Write the message Motion as a BLF file, 5,000 frames a second."""
    kinds = "S4, <u2, <u2, <u4, <u4, <u4, <u4, <u8, <u2, u1, u1, <u4, <u8"
    objects = np.zeros(count, dtype=kinds)
    head = (b"LOBJ", 32, 1, 48, 86, 2, 0)
    for name, value in zip(objects.dtype.names, (*head, 200_000 * np.arange(count), 1, 0, 8, 256), strict=False):
        objects[name] = value
    objects["f12"] = np.random.default_rng(0).integers(0, 2**63, count)
    blocks, size = [b"LOGG" + (144).to_bytes(4, "little") + bytes(136)], 2**17
    for begin in range(0, objects.nbytes, size):
        block = objects.view("V1")[begin : begin + size].tobytes()
        packed = zlib.compress(block, 1)
        blocks.append(struct.pack("<4sHHLLH6xL4x", b"LOBJ", 16, 1, 32 + len(packed), 10, 2, len(block)) + packed)
        blocks.append(bytes(len(packed) % 4))
    path.write_bytes(b"".join(blocks))
    return path


def raw_values(messages: list[can.Message], bus: int, name: str, signal: str) -> list[int | float | None]:
    """Return the raw values of a signal by cantools, frame by frame; ``None`` where a frame is too short."""
    described = cantools.database.load_string(DBC, "dbc").get_message_by_name(name)
    values = []
    for m in messages:
        if m.channel == bus and m.arbitration_id == described.frame_id:
            try:
                values.append(described.decode(m.data, decode_choices=False, scaling=False)[signal])
            except cantools.database.DecodeError:
                values.append(None)
    return values


def decoded(folder: Path, columns: dict[str, tuple[np.ndarray, np.ndarray]]) -> list[Path]:
    """Write decoded signals, stamps and values by name, as MF4 and as CSV, and return the files."""
    with MDF(version="4.10") as file:
        for name, (stamps, values) in columns.items():
            file.append([Signal(values, stamps, name=name)])
        file.save(folder / "decoded.mf4", overwrite=True)
    frame = pd.concat([pd.DataFrame({name: v}, index=t) for name, (t, v) in columns.items()], axis=1)
    frame.rename_axis("time").reset_index().to_csv(folder / "decoded.csv", index=False)
    return [folder / "decoded.mf4", folder / "decoded.csv"]
