"""The kinds of files that are broken: a strategy for their bytes, and what reads them."""

from __future__ import annotations

import gzip
import io
import json
import pickle
import tomllib
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path
from shutil import copy
from typing import Any

import numpy as np
import typer
from hypothesis import strategies as st
from typer.testing import CliRunner

from bench.fuzz import folders, loggers
from bench.fuzz.mutate import changed, damaged, large, numbers, texts, toml, values
from harness.cli.main import app
from harness.common import locations
from harness.models.roles import PARAMETERS

ROOT = Path(__file__).parents[2]
TIME = np.arange(0.0, 4.0, 0.02)
DATABASES = ("dbc", "kcd", "sym", "arxml")
COLUMNS = {
    "time": TIME,
    "speed": 20.0 + 0.1 * TIME,
    "yaw_rate": 0.1 * np.sin(TIME),
    "lateral_acceleration": 2.0 * np.sin(TIME),
    "steering_wheel_angle": 0.3 * np.sin(TIME + 0.2),
}


@dataclass(frozen=True)
class Kind:
    """A kind of file.

    Attributes:
        share: Of all inputs.
        name: Of the file that an input is written to.
        good: A file that is read; what the first reading of a kind imports is not watched.
        inputs: Strategy for its bytes.
        read: Reads the file.
        prepare: What is made of the file before, unwatched.
    """

    share: float
    name: str
    good: bytes
    inputs: st.SearchStrategy[bytes]
    read: Callable[[Path], object]
    prepare: Callable[[Path], object] = lambda _: None


def kinds(folder: Path) -> dict[str, Kind]:
    """Return every kind by name; good files of each are made in a folder."""
    made = folder / "good"
    made.mkdir(parents=True, exist_ok=True)
    good = _good(made)

    def tables(share: float, name: str, read: Callable[[Path], object], base: dict[str, Any]) -> Kind:
        text = toml(base).encode()
        spoilt = st.one_of(
            changed(base).map(lambda t: toml(t).encode()), damaged(text), damaged(b"\xef\xbb\xbf" + text), large()
        )
        return Kind(share, name, text, spoilt, read)

    def files(share: float, name: str, read: Callable[[Path], object], *further: st.SearchStrategy[bytes]) -> Kind:
        same = [content for good_name, content in good.items() if good_name.endswith(Path(name).suffix)]
        return Kind(share, name, good[name], st.one_of(*map(damaged, same), *further), read)

    table = _tables(made)
    return {
        "study": tables(0.18, "study.toml", _study, table["study"]),
        "drives": tables(0.05, "drives.toml", _drives, table["drives"]),
        "parameters": tables(0.08, "parameters.toml", _parameters, table["parameters"]),
        "channel map": tables(0.13, "map.toml", lambda path: _recording(made / "a.csv", path), table["map"]),
        "project": tables(0.04, "harness.toml", lambda path: locations.project_name(path.parent), {"name": "lab"}),
        "tuning": tables(0.04, "tuning.toml", _tuning, table["tuning"]),
        "loop": tables(0.04, "loop.toml", _loop, table["loop"]),
        "csv": files(0.15, "a.csv", _recording, _csv(), _csv(), _long()),
        "csv.gz": files(0.02, "a.csv.gz", _recording, _long().map(gzip.compress)),
        "options": Kind(0.015, "words.json", b'["run", "--jobs", "1", "-j", "2"]', _twice(), _refused),
        "mat": files(0.09, "a.mat", _recording),
        "mdf": files(0.06, "a.mf4", _recording),
        "parquet": files(0.05, "a.parquet", _recording),
        **{form: files(0.04, f"bus.{form}", lambda path: _bus(path, made / "bus.dbc")) for form in ("blf", "mf4")},
        **{
            form: files(0.02, f"bus.{form}", lambda path: _bus(path, made / "bus.dbc"))
            for form in ("asc", "log", "trc")
        },
        **{form: files(0.02, f"bus.{form}", lambda path: _bus(made / "bus.blf", path)) for form in DATABASES},
        "text of loggers": files(0.08, "a.csv", loggers.read, loggers.preambles(), loggers.preambles()),
        "vbo": files(0.02, "a.vbo", _tables_of),
        "tdx": files(0.01, "a.tdx", _tables_of),
        "erg": replace(files(0.01, "a.erg", _tables_of), prepare=lambda path: copy(made / "a.erg.info", path.parent)),
        "erg info": replace(
            files(0.01, "a.erg.info", lambda path: _tables_of(path.with_suffix(""))),
            prepare=lambda path: copy(made / "a.erg", path.parent),
        ),
        "tdms": files(0.02, "a.tdms", _tables_of),
        "mcap": files(0.03, "a.mcap", _tables_of),
        "db3": files(0.02, "a.db3", _tables_of),
        "bag": files(0.03, "a.bag", _tables_of),
        "network": files(0.07, "n.npz", _network, _npz()),
        "result folder": Kind(
            0.02,
            "recipe.json",
            folders.good(made / "result"),
            folders.recipes(made / "result"),
            folders.look,
            folders.prepare,
        ),
    }


@st.composite
def _csv(draw: st.DrawFn) -> bytes:
    """Return a table of a few rows in which anything may stand."""
    separator = draw(st.sampled_from((",", ";", "\t", " ")))
    names = draw(st.lists(st.one_of(st.sampled_from([*COLUMNS, "note", "true_yaw_rate"]), texts), max_size=5))
    cell = st.one_of(numbers.map(str), texts, st.sampled_from(("", "NaN", "0,5", "1.5", "-", "True")))
    rows = draw(st.integers(0, 6))
    lines = [separator.join(names)] if draw(st.booleans()) else []
    lines += draw(st.lists(st.sampled_from(("# comment", "% x", "", "s;m/s", "[s],[m]")), max_size=1))
    for i in range(rows):
        row = [str(0.01 * i), *(draw(cell) for _ in names[1:])]
        lines.append(separator.join(row))
    end = draw(st.sampled_from(("\n", "\r\n", "\r")))
    encoding = draw(st.sampled_from(("utf-8", "utf-8", "utf-8-sig", "utf-16", "latin-1")))
    return end.join(lines).encode(encoding, errors="replace")


@st.composite
def _long(draw: st.DrawFn) -> bytes:
    """Return a table with a long line, many columns, many rows or zeros, behind lines of a good one or none."""
    head = draw(st.sampled_from((b"", b"time,speed\n0,1\n0.1,1\n0.2,2\n", b"t;v\n1,500;1,500\n")))
    size = draw(st.sampled_from((1000, 2**20, 2**22)))
    piece = draw(st.sampled_from((b"\0", b"1", b"1,", b"0.1,1\n", b"\r\n", b"# x\n", b'"', b";")))
    return head + piece * (size // len(piece))


@st.composite
def _twice(draw: st.DrawFn) -> bytes:
    """Return the words of a command with an option of it that is given twice."""
    commands = typer.main.get_command(app).commands  # type: ignore[attr-defined]
    command = draw(st.sampled_from(sorted(commands)))
    options = [p for p in commands[command].params if p.param_type_name == "option" and not p.is_flag]
    option = draw(st.sampled_from(options)) if options else None
    first, second = draw(st.tuples(texts, texts).filter(lambda both: all(word.strip() for word in both)))
    if option is None:
        return b'["run", "--jobs", "1", "-j", "2"]'
    words = [draw(st.sampled_from(option.opts)), first, draw(st.sampled_from(option.opts))]
    return json.dumps([command, *words, first if option.multiple else second]).encode()


def _refused(path: Path) -> object:
    """Run a command whose words say something twice, and return what it says.

    Raises:
        ValueError: If it does not refuse that.
    """
    done = CliRunner().invoke(app, json.loads(path.read_bytes()))
    said = " ".join(done.output.replace("│", " ").split())
    if done.exit_code != 2 or "given twice" not in said:
        raise ValueError(f"is not refused: {done.exit_code} {said}")
    return said


@st.composite
def _npz(draw: st.DrawFn) -> bytes:
    """Return a network whose arrays or description are others, pickled code among them."""
    with np.load(_network_file(), allow_pickle=False) as file:
        arrays: dict[str, Any] = {name: file[name] for name in file.files}
    described = draw(st.one_of(changed(json.loads(str(arrays["description"]))), values))
    arrays["description"] = np.array(json.dumps(described))
    name = draw(st.sampled_from(sorted(arrays)))
    pickled = np.empty(1, dtype=object)
    pickled[0] = _Evil()
    choices = (
        np.zeros(0),
        np.zeros((2, 2)),
        np.array("x"),
        np.full((3, 3), np.nan),
        np.zeros((1, 1, 1)),
        pickled,
        None,
    )
    choice = draw(st.sampled_from(choices))
    if choice is not None:
        arrays[name] = choice
    buffer = io.BytesIO()
    np.savez(buffer, allow_pickle=True, **arrays)
    content = buffer.getvalue()
    return pickle.dumps(_Evil()) if draw(st.integers(0, 30)) == 0 else content


class _Evil:
    """Runs code when it is unpickled."""

    def __reduce__(self) -> tuple[Any, ...]:
        return (exec, ("import os; os.system('echo code of a file runs')",))


def _network_file() -> Path:
    return ROOT / "harness" / "estimation" / "networks" / "semitrailer_24t.npz"


def _good(folder: Path) -> dict[str, bytes]:
    """Write a good file of each binary kind, and return the bytes."""
    import cantools
    import h5py
    import pandas as pd
    import scipy.io
    from asammdf import MDF, Signal

    from support import bus_logs

    table = pd.DataFrame(COLUMNS)
    table.to_csv(folder / "a.csv", index=False)
    (folder / "a.csv.gz").write_bytes(gzip.compress((folder / "a.csv").read_bytes(), mtime=0))
    table.to_parquet(folder / "a.parquet", index=False)
    scipy.io.savemat(folder / "a.mat", {**COLUMNS, "log": COLUMNS, "name": "x"}, do_compression=True)
    scipy.io.savemat(folder / "plain.mat", dict(COLUMNS), do_compression=False)
    with h5py.File(folder / "b.mat", "w", userblock_size=512) as file:
        for name, column in COLUMNS.items():
            file.create_dataset(name, data=column[None])
    content = bytearray((folder / "b.mat").read_bytes())
    content[:128] = b"MATLAB 7.3 MAT-file".ljust(124) + b"\x00\x02IM"
    (folder / "b.mat").write_bytes(bytes(content))
    for name, compression in (("a.mf4", 0), ("b.mf4", 2)):
        with MDF(version="4.10") as file:
            file.append([Signal(v, TIME, name=n) for n, v in COLUMNS.items() if n != "time"])
            file.save(folder / name, overwrite=True, compression=compression)
    for form in ("blf", "asc", "log", "trc", "mf4"):
        bus_logs.write(folder / f"bus.{form}", bus_logs.frames(5))
    described = cantools.database.load_string(bus_logs.DBC, "dbc")
    databases = (bus_logs.DBC, described.as_kcd_string(), described.as_sym_string(), bus_logs.ARXML)
    for form, text in zip(DATABASES, databases, strict=True):
        (folder / f"bus.{form}").write_text(text, encoding="utf-8")
    loggers.write(folder)
    (folder / "n.npz").write_bytes(_network_file().read_bytes())
    return {p.name: p.read_bytes() for p in folder.iterdir() if p.is_file()}


def _tables(folder: Path) -> dict[str, dict[str, Any]]:
    """Return the content of a good file of each TOML kind."""
    study = tomllib.loads((ROOT / "bench" / "fuzz" / "study.toml").read_text(encoding="utf-8"))
    drives = {"title": "a", "drive": study["drive"]}
    tuning = {
        "rule": "likelihood",
        "drives": ["sine"],
        "budget": 10,
        "estimator": {"EKF": {"process": 2.0, "unknown_inputs": 1.0, "measurement": 0.5}},
    }
    (folder / "study-of-tuning.toml").write_text(toml(study | {"tuning": "../tuning.toml"}), encoding="utf-8")
    mapped = {
        "title": "a map",
        "recording": {"reference": "CoG", "step": "20 ms", "start": 0.2, "stop": 3.5},
        "time": {"channel": "time", "unit": "s"},
        "speed": {"channel": "speed", "unit": "m/s", "factor": 1.0, "offset": 0.0, "lag": 0.05},
        "yaw_rate": {"channel": "yaw_rate", "unit": "deg/s", "delay": 0.02, "remove_spikes": True},
        "lateral_acceleration": {"channel": "lateral_acceleration", "unit": "g_0"},
        "points": {"imu": {"x": 0.4, "y": 0.1}},
        "derive": {"signals": ["yaw_acceleration"]},
    }
    published = PARAMETERS.load("govindarajan_2018")
    parameters = {
        "vehicle": "car",
        "tyre": "magic_formula",
        "source": "x",
        "sensors": "car_series",
        "noise_step": "10 ms",
        "values": {**published.VALUES, "mass": "1.5 t"},
        "process_noise": dict(published.PROCESS_NOISE),
        "measurement_noise": {**published.MEASUREMENT_NOISE, "yaw_rate": "1e-4 rad**2/s**2"},
    }
    loop = tomllib.loads((ROOT / "studies" / "loops" / "genesis.toml").read_text(encoding="utf-8"))
    return {"study": study, "drives": drives, "tuning": tuning, "map": mapped, "parameters": parameters, "loop": loop}


def _study(path: Path) -> object:
    from harness.config import load_study
    from harness.simulation.drives import profile_of

    study = load_study(path)
    return [profile_of(study.plant, drive) for drive in study.drives if _seconds(drive.options) < 600.0]


def _seconds(options: dict[str, Any]) -> float:
    """Return how long a drive may be, so that no time goes into valid drives of days."""
    numbers_of = [v for v in options.values() if isinstance(v, int | float) and not isinstance(v, bool)]
    return max([0.0, *(abs(float(v)) for v in numbers_of)])


def _drives(path: Path) -> object:
    from harness.simulation.drives import read_drives

    return read_drives(path)


def _parameters(path: Path) -> object:
    from harness.config import resolve_single

    return resolve_single({"vehicle": "car", "parameters": str(path), "sensors": "car_series"}, "command line")


def _tuning(path: Path) -> object:
    from harness.config import load_study

    return load_study(path.parent / "good" / "study-of-tuning.toml")


def _loop(path: Path) -> object:
    from harness.identification.measured_file import MeasuredStudy

    return MeasuredStudy.read(path)


def _recording(path: Path, channels: Path | None = None) -> object:
    from harness.recordings import load_recording

    return load_recording(path, channels)


def _bus(path: Path, database: Path) -> object:
    from harness.recordings.readers import read_tables

    return read_tables(path, None, [str(database)])


def _tables_of(path: Path) -> object:
    from harness.recordings import readers

    return readers.read_tables(path)


def _network(path: Path) -> object:
    from harness.estimation.narx_network import load

    return load(path)
