"""MATLAB files: up to version 7.2 through SciPy, version 7.3, which is HDF5, through h5py.

Of what Simulink writes are read: arrays of ``To File`` and ``To Workspace`` whose first row or column is the time, and
structures with time. Objects (``timeseries``, data sets) only MATLAB reads; what to type there is said.
"""

from __future__ import annotations

import math
import struct
import zlib
from collections.abc import Iterator
from dataclasses import dataclass, field
from typing import Any

import h5py
import numpy as np
import scipy.io

from harness.common.arrays import Floats
from harness.common.errors import UserError
from harness.common.files import refuse_beyond, refuse_damaged
from harness.recordings.readers._table import MOST_BYTES, MOST_COLUMNS, Table, by_length

SUFFIXES = (".mat",)

_COMPRESSED = 15
"""Kind of an element that zlib packed."""
_SHORTEST = 10
"""Samples of an array whose first row or column is the time."""
_WIDEST = 0.5
"""Signals over samples of such an array."""
_IN_MATLAB = {
    True: "s = struct('time', {0}.Time, 'values', squeeze({0}.Data)); save('{0}_s.mat', 's')",
    False: "for i = 1:{0}.numElements, e = {0}{{i}}.Values; s.(matlab.lang.makeValidName(e.Name)) = "
    "struct('time', e.Time, 'values', squeeze(e.Data)); end, save('{0}_s.mat', '-struct', 's')",
}
"""What makes vectors of an object in MATLAB, by whether it is a time series or a data set of them."""


@dataclass
class _Content:
    """What a file holds.

    Attributes:
        vectors: Numeric vectors by dotted names.
        left_out: Arrays that are none, with their shapes.
        objects: Variables that are objects of MATLAB, with their classes.
    """

    vectors: dict[str, Floats] = field(default_factory=dict)
    left_out: dict[str, str] = field(default_factory=dict)
    objects: dict[str, str] = field(default_factory=dict)

    def add(self, name: str, values: Any) -> None:
        """Add a numeric array: a vector, or signals over a time that is their first row or column."""
        if values.ndim == 2 and min(values.shape) == 1:
            values = values.ravel()
        if values.ndim == 1:
            self.vectors[name] = values.astype(float)
            return
        rows = None if values.ndim != 2 else next((v for v in (values, values.T) if _is_timed(v)), None)
        if rows is None:
            self.left_out[name] = "×".join(map(str, values.shape))
            return
        self.vectors[f"{name}.time"] = rows[0].astype(float)
        for n, row in enumerate(rows[1:], 1):
            self.vectors[name if len(rows) == 2 else f"{name}.{n}"] = row.astype(float)

    def add_signals(self, name: str, values: Any) -> None:
        """Add the values of a structure with time: a column for each signal."""
        if values.ndim != 2 or min(values.shape) == 1:
            self.add(name, values)
            return
        for n, column in enumerate(values.T if values.shape[0] >= values.shape[1] else values, 1):
            self.vectors[f"{name}.{n}"] = column.astype(float)


def _is_timed(rows: Any) -> bool:
    """Return whether the first of some rows rises from sample to sample as a time does."""
    count, samples = rows.shape
    if count < 2 or samples < _SHORTEST or count > _WIDEST * samples or count > MOST_COLUMNS:
        return False
    first = rows[0].astype(float)
    return bool(np.isfinite(first).all() and (np.diff(first) > 0).all())


def read(path: str) -> list[Table]:
    """Return the numeric vectors of a MATLAB file, those inside structures as ``structure.field``.

    Recordings hold scalars, parameters and texts besides their signals, and sometimes signals of several rates. The
    vectors are grouped by their length; scalars, texts and matrices that hold no time are left out.

    Raises:
        UserError: If the file is damaged, or holds objects or arrays without a time alone.
    """
    content = _Content()
    with refuse_damaged(path, "MATLAB file"):
        try:
            try:
                claimed = sum(8 * math.prod(shape) for _, shape, _ in scipy.io.whosmat(path))
            except TypeError:  # which it raises of an object, whose shape it does not know
                claimed = _unpacked(path)
            refuse_beyond(path, "the file, unpacked,", claimed, MOST_BYTES, "bytes")
            variables = scipy.io.loadmat(path, squeeze_me=True, struct_as_record=False)
        except NotImplementedError:  # how SciPy says version 7.3
            with h5py.File(path, "r") as file:
                claimed = sum(8 * d.size for d in _datasets(file))
                refuse_beyond(path, "the file, unpacked,", claimed, MOST_BYTES, "bytes")
                _collect_hdf5("", file, content)
        except ValueError as error:
            if "Unknown mat file type" not in str(error):  # which it says of any bytes, with two of them as a version
                raise
            raise UserError(
                f"{path}: is damaged or no MATLAB file: it does not begin as one of version 4, 5, 6, 7 or 7.3; export "
                "it again"
            ) from None
        else:
            for name, value in variables.items():
                if isinstance(value, scipy.io.matlab.MatlabOpaque):
                    content.objects |= {_text(row["s0"]) or name: _text(row["s2"]) for row in np.atleast_1d(value)}
                elif not name.startswith("__"):
                    _collect(name, value, content)
    tables = by_length(content.vectors)
    said = [
        f"'{name}' is a MATLAB object ({kind}); in MATLAB type: {_IN_MATLAB['timeseries' in kind].format(name)}"
        for name, kind in content.objects.items()
    ]
    if not tables and (said or content.left_out):
        said += [
            f"'{name}' is an array of {shape} whose first row is no time; store it as vectors, or with the time first"
            for name, shape in content.left_out.items()
        ]
        raise UserError(f"{path}: holds no vector of samples: {'; '.join(said[:3])}")
    if tables and said:
        tables[0] = Table(tables[0].columns, notes=tuple(f"left out: {each}" for each in said[:3]))
    return tables


def _unpacked(path: str) -> int:
    """Return the bytes that the variables of a file of version 5 to 7.2 are unpacked into, or more than any may."""
    total = 128
    with open(path, "rb") as file:
        file.seek(total)
        while len(tag := file.read(8)) == 8 and total <= MOST_BYTES:
            kind, size = struct.unpack("<II", tag)
            packed, unpacking = file.read(size), zlib.decompressobj()
            if kind != _COMPRESSED:
                total += size
            while kind == _COMPRESSED and packed and not unpacking.eof and total <= MOST_BYTES:
                total += len(unpacking.decompress(packed, 2**20))
                packed = unpacking.unconsumed_tail
    return total


def _datasets(group: h5py.Group) -> Iterator[h5py.Dataset]:
    for value in group.values():
        if isinstance(value, h5py.Group):
            yield from _datasets(value)
        elif isinstance(value, h5py.Dataset):
            yield value


def _text(value: Any) -> str:
    """Return a name that SciPy gives as bytes or text."""
    return value.decode("latin-1") if isinstance(value, bytes) else str(value)


def _collect(name: str, value: Any, content: _Content) -> None:
    """Add a real numeric array, or those inside a structure, under dotted names."""
    if isinstance(value, scipy.io.matlab.mat_struct):
        fields = getattr(value, "_fieldnames", ())
        timed = "signals" in fields and "time" in fields
        for key in fields:
            inner = getattr(value, key)
            if timed and key == "signals":
                _collect_signals(f"{name}.{key}", inner, content)
            else:
                _collect(f"{name}.{key}", inner, content)
    elif isinstance(value, np.ndarray) and value.size > 1 and value.dtype.kind in "bfiu":
        content.add(name, value)


def _collect_signals(name: str, signals: Any, content: _Content) -> None:
    """Add the signals of a structure with time, several of them by their labels or numbers."""
    several = isinstance(signals, np.ndarray)
    for n, signal in enumerate(signals.ravel() if several else [signals], 1):
        values, label = getattr(signal, "values", None), getattr(signal, "label", "")
        inner = f"{name}.{label if isinstance(label, str) and label else n}" if several else f"{name}.values"
        if isinstance(values, np.ndarray) and values.dtype.kind in "bfiu":
            content.add_signals(f"{name}.{n}" if inner in content.vectors else inner, values)


def _collect_hdf5(name: str, group: h5py.Group, content: _Content) -> None:
    """Add the real numeric arrays of an HDF5 group; MATLAB keeps texts, cells and references apart by class."""
    for key, value in group.items():
        if key.startswith("#"):  # where MATLAB keeps what cells and strings refer to
            continue
        full = f"{name}.{key}" if name else key
        if isinstance(value, h5py.Group):
            _collect_hdf5(full, value, content)
        elif isinstance(value, h5py.Dataset):
            kind = _text(value.attrs.get("MATLAB_class", b""))
            if "MATLAB_object_decode" in value.attrs:
                content.objects[full] = kind
            elif value.dtype == h5py.ref_dtype and key == "values" and "label" in group:  # signals of a structure
                for n, place in enumerate(value[()].ravel(), 1):
                    if isinstance(signal := group.file[place], h5py.Dataset) and signal.dtype.kind in "bfiu":
                        content.add_signals(f"{name}.{_label(group, n) or n}", np.asarray(signal).T)
            elif value.dtype.kind in "bfiu" and kind != "char" and "MATLAB_empty" not in value.attrs:
                shape = [length for length in value.shape if length > 1]
                if len(shape) == 2 and key == "values" and "label" in group:
                    content.add_signals(full, np.asarray(value).T)
                elif len(shape) < 3 and value.size > 1:
                    content.add(full, np.asarray(value, dtype=float).reshape(shape).T)


def _label(group: h5py.Group, number: int) -> str:
    """Return the label of a signal of a structure with time; empty if it has none."""
    places = group["label"]
    if places.dtype != h5py.ref_dtype or places.size < number:
        return ""
    text = group.file[places[()].ravel()[number - 1]]
    if _text(text.attrs.get("MATLAB_class", b"")) != "char" or "MATLAB_empty" in text.attrs:
        return ""
    return "".join(map(chr, np.asarray(text).ravel()))
