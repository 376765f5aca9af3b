"""Chunks written without Zarr's machinery are the files that Zarr writes."""

import numpy as np
import pytest
import zarr

from harness.common import places
from harness.study.store import ChunkEncoder

DIMS = ("band", "sample", "drive", "repeat", "estimator", "target")


def made(folder, dtype="float64", fill=np.nan, dims=DIMS, shape=(2, 5, 3, 7, 2, 2), **further):
    """An array whose units have three samples and four repeats, so that the last ones are not full."""
    own = {"band": 1, "sample": 3, "drive": 1, "repeat": 4}
    root = zarr.open_group(str(folder), mode="w", zarr_format=3)
    return root.create_array(
        "level/score",
        shape=shape,
        chunks=[own.get(d, n) for d, n in zip(dims, shape, strict=True)],
        dtype=dtype,
        fill_value=fill,
        dimension_names=dims,
        **further,
    )


def files(folder):
    return {p.relative_to(folder): p.read_bytes() for p in folder.rglob("*") if p.is_file()}


@pytest.mark.parametrize(("dtype", "fill"), [("float64", np.nan), ("float32", np.nan), ("int8", -1)])
@pytest.mark.parametrize("further", [{}, {"compressors": None}], ids=["packed", "plain"])
def test_every_chunk_is_that_of_zarr_to_the_bit(tmp_path, dtype, fill, further):
    ours, theirs = (made(tmp_path / name, dtype, fill, **further) for name in ("ours", "theirs"))
    encoder, draw = ChunkEncoder(ours), np.random.default_rng(1)
    for band, drive, first, repeat in np.ndindex(2, 3, 2, 2):
        samples, repeats = slice(3 * first, min(3 * first + 3, 5)), slice(4 * repeat, min(4 * repeat + 4, 7))
        shape = (samples.stop - samples.start, repeats.stop - repeats.start, 2, 2)
        values = (100 * draw.standard_normal(shape)).astype(dtype)
        if (band, drive) == (1, 1):
            values = np.full(shape, fill, dtype=dtype)  # takes no file
        elif (band, drive) == (1, 2):
            values[0] = fill
        theirs[band, samples, drive, repeats] = values
        path = tmp_path / "ours" / "level" / "score" / "c" / f"{band}/{first}/{drive}/{repeat}/0/0"
        places.write(path, encoder.encode(values))
    assert files(tmp_path / "ours") == files(tmp_path / "theirs")
    assert len(files(tmp_path / "ours")) == 3 + 2 * 3 * 4 - 4


def test_an_array_without_drives_is_written_as_well(tmp_path):
    dims, shape = ("band", "sample", "repeat", "estimator", "window"), (1, 5, 4, 1, 9)
    ours, theirs = (made(tmp_path / name, "float32", np.nan, dims, shape) for name in ("ours", "theirs"))
    values = np.random.default_rng(2).standard_normal((3, 4, 1, 9)).astype("float32")
    theirs[0, 0:3] = values
    places.write(tmp_path / "ours" / "level/score/c/0/0/0/0/0", ChunkEncoder(ours).encode(values))
    assert files(tmp_path / "ours") == files(tmp_path / "theirs")


def test_a_chunk_that_holds_nothing_any_more_is_removed(tmp_path):
    file = tmp_path / "c" / "0"
    places.write(file, b"content")
    places.write(file, None)
    places.write(file, None)
    assert files(tmp_path) == {}


def test_a_write_that_fails_leaves_what_was_there(tmp_path, monkeypatch):
    file = tmp_path / "c" / "0"
    places.write(file, b"before")

    def full(self, target):
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(places.os, "replace", full)
    with pytest.raises(OSError, match="No space"):
        places.write(file, b"after")
    assert list(files(tmp_path).values()) == [b"before"]


def test_other_codecs_are_refused(tmp_path):
    with pytest.raises(ValueError, match="cannot encode"):
        ChunkEncoder(made(tmp_path, compressors=zarr.codecs.GzipCodec()))
