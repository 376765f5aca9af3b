"""MATLAB files: up to version 7.2 through SciPy, version 7.3, which is HDF5, through h5py."""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import Any

import h5py
import numpy as np
import scipy.io

from harness.common.arrays import Floats
from harness.common.errors import UserError
from harness.common.files import refuse_beyond, refuse_damaged
from harness.recordings.readers._table import MOST_BYTES, Table, by_length

SUFFIXES = (".mat",)

Vectors = dict[str, Floats]


def read(path: str) -> list[Table]:
    """Return the numeric vectors of a MATLAB file, those inside structures as ``structure.field``.

    Recordings hold scalars, parameters and texts beside their signals, and sometimes signals of several rates. The
    vectors are grouped by their length; scalars, matrices and texts are left out.

    Raises:
        UserError: If the file is damaged.
    """
    vectors: Vectors = {}
    with refuse_damaged(path, "MATLAB file"):
        try:
            claimed = sum(8 * math.prod(shape) for _, shape, _ in scipy.io.whosmat(path))
            refuse_beyond(path, "the file, unpacked,", claimed, MOST_BYTES, "bytes")
            content = scipy.io.loadmat(path, squeeze_me=True, struct_as_record=False)
        except NotImplementedError:  # how SciPy says version 7.3
            with h5py.File(path, "r") as file:
                claimed = sum(8 * d.size for d in _datasets(file))
                refuse_beyond(path, "the file, unpacked,", claimed, MOST_BYTES, "bytes")
                _collect_hdf5("", file, vectors)
        except ValueError as error:
            if "Unknown mat file type" not in str(error):  # which it says of any bytes, with two of them as a version
                raise
            raise UserError(
                f"{path}: is damaged or no MATLAB file: it does not begin as one of version 4, 5, 6, 7 or 7.3; export "
                "it again"
            ) from None
        else:
            for name, value in content.items():
                if not name.startswith("__"):
                    _collect(name, value, vectors)
    return by_length(vectors)


def _datasets(group: h5py.Group) -> Iterator[h5py.Dataset]:
    for value in group.values():
        if isinstance(value, h5py.Group):
            yield from _datasets(value)
        elif isinstance(value, h5py.Dataset):
            yield value


def _collect(name: str, value: Any, vectors: Vectors) -> None:
    """Add a real numeric vector, or those inside a structure, under dotted names."""
    if isinstance(value, scipy.io.matlab.mat_struct):
        for field in getattr(value, "_fieldnames", ()):
            _collect(f"{name}.{field}", getattr(value, field), vectors)
    elif isinstance(value, np.ndarray) and value.ndim == 1 and value.dtype.kind in "bfiu":
        vectors[name] = value.astype(float)


def _collect_hdf5(name: str, group: h5py.Group, vectors: Vectors) -> None:
    """Add the real numeric vectors of an HDF5 group; MATLAB keeps texts, cells and references apart by class."""
    for key, value in group.items():
        if key.startswith("#"):  # where MATLAB keeps what cells and strings refer to
            continue
        full = f"{name}.{key}" if name else key
        if isinstance(value, h5py.Group):
            _collect_hdf5(full, value, vectors)
        elif isinstance(value, h5py.Dataset) and value.dtype.kind in "bfiu":
            is_text = value.attrs.get("MATLAB_class", b"") == b"char" or "MATLAB_empty" in value.attrs
            if not is_text and value.size == max(value.shape, default=0):
                vectors[full] = np.asarray(value, dtype=float).ravel()
