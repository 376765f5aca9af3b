"""MATLAB files up to version 7.2, through SciPy; version 7.3 is HDF5 and has to be saved as ``-v7``."""

from __future__ import annotations

import zlib
from collections import Counter
from typing import Any

import numpy as np
import scipy.io
from numpy.typing import NDArray

from harness.errors import UserError

SUFFIXES = (".mat",)


def read(path: str) -> dict[str, NDArray[np.float64]]:
    """Return the numeric vectors of a MATLAB file, those inside structures as ``structure.field``.

    Recordings hold scalars, parameters and texts beside their signals. The signals are the vectors of
    the length that most of them share (the longer one if two are as frequent); the others are left out.

    Raises:
        UserError: If the file is of version 7.3 or damaged.
    """
    try:
        content = scipy.io.loadmat(path, squeeze_me=True, struct_as_record=False)
    except NotImplementedError:
        raise UserError(
            f"{path}: is a MATLAB file of version 7.3; save it with save(file, '-v7') or as CSV or Parquet"
        ) from None
    except (ValueError, TypeError, KeyError, EOFError, zlib.error, scipy.io.matlab.MatReadError) as error:
        raise UserError(f"{path}: is no readable MATLAB file: {error}") from None
    vectors: dict[str, NDArray[np.float64]] = {}
    for name, value in content.items():
        if not name.startswith("__"):
            _collect(name, value, vectors)
    lengths = Counter(len(v) for v in vectors.values())
    if not lengths:
        return {}
    samples = max(lengths, key=lambda n: (lengths[n], n))
    return {name: v for name, v in vectors.items() if len(v) == samples}


def _collect(name: str, value: Any, vectors: dict[str, NDArray[np.float64]]) -> None:
    """Add a real numeric vector, or those inside a structure, under dotted names."""
    if isinstance(value, scipy.io.matlab.mat_struct):
        for field in getattr(value, "_fieldnames", ()):
            _collect(f"{name}.{field}", getattr(value, field), vectors)
    elif isinstance(value, np.ndarray) and value.ndim == 1 and value.dtype.kind in "bfiu":
        vectors[name] = value.astype(float)
