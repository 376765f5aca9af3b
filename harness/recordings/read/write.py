"""Write a recording to a file that other programs read: CSV, Parquet or netCDF."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

from harness.common import places
from harness.common.errors import UserError
from harness.common.files import refuse_special

if TYPE_CHECKING:
    import xarray as xr

SUFFIXES = (".csv", ".parquet", ".nc")


def check_target(path: Path) -> None:
    """Refuse a file that could not be written, before the work starts.

    Raises:
        UserError: If the suffix is unknown, the folder does not exist, or it is a pipe or a device.
    """
    if path.suffix not in SUFFIXES:
        raise UserError(f"{path}: the suffix says the format; use one of {', '.join(SUFFIXES)}")
    if not path.parent.is_dir():
        raise UserError(f"{path}: there is no folder {path.parent}; make it first")
    refuse_special(path)


def write_recording(recording: xr.Dataset, path: Path) -> None:
    """Write the signals over time, one column each, under their names and in SI units.

    Args:
        recording: Variables over the one dimension ``time``.
        path: File; its suffix says the format. netCDF keeps units and provenance as attributes, CSV and
            Parquet keep the columns alone, as the readers of this project expect them.

    Raises:
        UserError: If the file cannot be written.
    """
    check_target(path)
    try:
        with places.unfinished(path) as stream:
            if path.suffix == ".nc":
                stream.write(recording.to_netcdf())
            elif path.suffix == ".csv":
                recording.to_dataframe().reset_index().to_csv(stream, index=False)
            else:
                recording.to_dataframe().reset_index().to_parquet(stream, index=False)
    except OSError as error:
        raise UserError(f"{path}: cannot be written: {error.strerror or error}") from None
