"""Write a recording to a file that other programs read: CSV, Parquet, netCDF, MF4 or MCAP."""

from __future__ import annotations

import io
import json
import tempfile
from collections.abc import Callable
from datetime import UTC, datetime
from importlib.util import find_spec
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from harness.common import places
from harness.common.errors import UserError
from harness.common.files import refuse_special
from harness.recordings.readers.bag import OWN_TYPE

if TYPE_CHECKING:
    import xarray as xr

    from harness.common.arrays import Floats

_TOPIC = "/harness"
_LITTLE_ENDIAN = b"\0\1\0\0"
_UNIT = b"unit"
"""Key of the metadata of a column of Parquet."""


def check_target(path: Path) -> None:
    """Refuse a file that could not be written, before the work starts.

    Raises:
        UserError: If the suffix is unknown, a package for it is not installed, the folder does not exist, or it is a
            pipe or a device.
    """
    if path.suffix not in _CONTENTS:
        raise UserError(f"{path}: the suffix says the format; use one of {', '.join(_CONTENTS)}")
    check_packages(path.suffix[1:])
    if not path.parent.is_dir():
        raise UserError(f"{path}: there is no folder {path.parent}; make it first")
    refuse_special(path)


def check_packages(form: str) -> None:
    """Refuse a format whose package is not installed.

    Raises:
        UserError: If it is not.
    """
    package, extra = {"mf4": ("asammdf", "mdf"), "mcap": ("mcap", "ros")}.get(form, ("", ""))
    if package and find_spec(package) is None:
        raise UserError(
            f"{form.upper()} files are written with {package}, which is not installed: "
            f'pip install "robustness-harness[{extra}]"'
        )


def write_recording(recording: xr.Dataset, path: Path) -> None:
    """Write the signals over time, one column each, under their names and in SI units.

    Args:
        recording: Variables over the one dimension ``time``. Its attribute ``start`` is the stamp of the first sample
            on the clock of the log in s, ``begun`` when that clock was zero in s since 1970.
        path: File; its suffix says the format. netCDF keeps units and provenance as attributes. MF4, MCAP and Parquet
            keep units and have the stamps of the log: MF4 and MCAP as time, Parquet as the column ``log_time``. CSV
            keeps the columns alone. The columns of CSV and Parquet are those that this project reads.

    Raises:
        UserError: If the file cannot be written.
    """
    check_target(path)
    try:
        with places.unfinished(path) as stream:
            stream.write(_CONTENTS[path.suffix](recording))
    except OSError as error:
        raise UserError(f"{path}: cannot be written: {error.strerror or error}") from None


def _stamps(recording: xr.Dataset) -> Floats:
    """Return the time of the samples on the clock of the log in s ``(samples,)``."""
    return recording["time"].to_numpy() + float(recording.attrs.get("start", 0.0))


def _units(recording: xr.Dataset) -> dict[str, str]:
    """Return the units of variables and time; those of plain numbers are left out."""
    units = {str(name): str(v.attrs.get("units", "")) for name, v in recording.variables.items()}
    return {name: unit for name, unit in units.items() if unit not in ("", "1", "dimensionless")}


def _csv(recording: xr.Dataset) -> bytes:
    return recording.to_dataframe().reset_index().to_csv(index=False).encode()


def _parquet(recording: xr.Dataset) -> bytes:
    import pyarrow as pa
    import pyarrow.parquet as pq

    frame = recording.to_dataframe().reset_index()
    units = _units(recording)
    if recording.attrs.get("start"):
        frame["log_time"], units["log_time"] = _stamps(recording), "s"
    table = pa.Table.from_pandas(frame, preserve_index=False)
    fields = [f.with_metadata({_UNIT: units[f.name]}) if f.name in units else f for f in table.schema]
    stream = io.BytesIO()
    pq.write_table(table.cast(pa.schema(fields, table.schema.metadata)), stream)
    return stream.getvalue()


def _netcdf(recording: xr.Dataset) -> bytes:
    return bytes(recording.to_netcdf())


def _mf4(recording: xr.Dataset) -> bytes:
    from asammdf import MDF, Signal

    stamps, units = _stamps(recording), _units(recording)
    with tempfile.TemporaryDirectory(prefix="mdf-") as folder, MDF(version="4.10", temporary_folder=folder) as file:
        file.header.start_time = datetime.fromtimestamp(float(recording.attrs.get("begun", 0.0)), UTC)
        signals = [
            Signal(v.to_numpy(), stamps, units.get(str(name), ""), str(name), comment=str(v.attrs.get("long_name", "")))
            for name, v in recording.data_vars.items()
        ]
        file.append(signals, acq_name=str(recording.attrs.get("estimator", "harness")))
        return Path(file.save(Path(folder, "file.mf4"), compression=2)).read_bytes()


def _mcap(recording: xr.Dataset) -> bytes:
    """Return a bag of ROS 2 with one topic, whose messages have a number for each signal (CDR)."""
    from mcap.writer import Writer

    variables, units = list(recording.data_vars.values()), _units(recording)
    fields = [
        f"float64 {v.name} # {v.attrs.get('long_name', v.name)}, {units.get(str(v.name), '1')}" for v in variables
    ]
    stream = io.BytesIO()
    writer = Writer(stream)
    writer.start(profile="ros2", library="robustness-harness")
    schema = writer.register_schema(OWN_TYPE, "ros2msg", "\n".join(fields).encode())
    channel = writer.register_channel(_TOPIC, "cdr", schema, {"units": json.dumps(units)})
    stamps = _stamps(recording)
    begun = max(round(float(recording.attrs.get("begun", 0.0)) * 1e9), -round(stamps[0] * 1e9))  # no time is negative
    rows = np.stack([v.to_numpy().astype("<f8") for v in variables], axis=1)
    for stamp, row in zip(stamps.tolist(), rows, strict=True):
        at = begun + round(stamp * 1e9)
        writer.add_message(channel, at, _LITTLE_ENDIAN + row.tobytes(), at)
    writer.finish()
    return stream.getvalue()


_CONTENTS: dict[str, Callable[[xr.Dataset], bytes]] = {
    ".csv": _csv,
    ".parquet": _parquet,
    ".nc": _netcdf,
    ".mf4": _mf4,
    ".mcap": _mcap,
}
