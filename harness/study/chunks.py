"""Write the scores of a unit as chunks of a Zarr store, bit for bit as Zarr does, without its machinery.

A unit is one chunk of every array, and there may be millions of units. Zarr plans each write and hands it to another
thread, which for runs of a few seconds takes longer than to compute them. Here a chunk is padded, encoded by what the
metadata of its array say; ``harness.common.places`` writes it.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
from numcodecs.zstd import Zstd
from numpy.typing import NDArray


class ChunkEncoder:
    """Encodes the chunks of one array.

    Args:
        array: The array, opened by Zarr.

    Raises:
        ValueError: If its metadata ask for something that ``harness.study.layout`` does not.
    """

    def __init__(self, array: Any) -> None:
        metadata = array.metadata.to_dict()
        self._dims = [str(d) for d in metadata["dimension_names"]]
        self._shape = tuple(array.chunks)
        self._fill = array.fill_value
        first, *packed = metadata["codecs"]
        endian = (first.get("configuration") or {}).get("endian", "little")
        if first["name"] != "bytes" or str(getattr(endian, "value", endian)) != "little":
            raise ValueError(f"{array.path}: cannot encode {first}")
        self._type = array.dtype.newbyteorder("<")
        self._pack: list[Callable[[bytes], bytes]] = []
        for codec in packed:
            if codec["name"] != "zstd":
                raise ValueError(f"{array.path}: cannot encode {codec}")
            self._pack.append(Zstd(**codec["configuration"]).encode)

    def encode(self, values: NDArray[Any]) -> bytes | None:
        """Return a chunk as it lies in its file; ``None`` if it holds nothing but the fill value, which takes none.

        Args:
            values: Of one unit: along every dimension of the array but band and drive.
        """
        places = iter(values.shape)
        within = tuple(1 if d in ("band", "drive") else next(places) for d in self._dims)
        values = values.reshape(within)
        if within != self._shape:  # the last along samples or repeats
            whole = np.full(self._shape, self._fill, dtype=self._type)
            whole[tuple(slice(n) for n in within)] = values
            values = whole
        if bool(np.all(np.isnan(values)) if self._fill != self._fill else np.all(values == self._fill)):
            return None
        content = np.ascontiguousarray(values, dtype=self._type).tobytes()
        for pack in self._pack:
            content = bytes(pack(content))
        return content
