"""A folder with one signal per file, one value per line: ``yawRate.txt.gz`` becomes the column ``yawRate``."""

from __future__ import annotations

from pathlib import Path

from harness.common.arrays import Floats
from harness.common.errors import UserError
from harness.recordings import readers
from harness.recordings.readers import bag

SUFFIXES = ("/",)


def read(path: str, wanted: readers.Wanted | None = None) -> list[readers.Table]:
    """Return the topics of a bag of ROS 2, or the columns of the files that hold exactly one, grouped by their length.

    A column is named after its file. Files of unknown suffix, such as a licence, are passed over, and so are those with
    several columns, which are recordings of their own.

    Raises:
        UserError: If a file cannot be read, two have the same stem, or none holds a single column.
    """
    if bag.is_bag(path):
        return bag.read(path, wanted)
    suffixes = [suffix for suffix in readers.suffixes() if suffix not in (*SUFFIXES, *bag.SUFFIXES)]
    vectors: dict[str, Floats] = {}
    for file in sorted(p for p in Path(path).iterdir() if p.is_file()):
        suffix = next((s for s in suffixes if file.name.lower().endswith(s)), None)
        if suffix is None:
            continue
        columns = readers.read(file)
        if len(columns) != 1:
            continue
        stem = file.name[: -len(suffix)]
        if stem in vectors:
            raise UserError(f"{path}: two files are named '{stem}'; rename one")
        (vectors[stem],) = columns.values()
    if not vectors:
        parts = sorted(p.name for p in Path(path).iterdir() if p.suffix.lower() in bag.SUFFIXES)
        if parts:
            raise UserError(
                f"{path}: holds {parts[0]} and no {bag.FOLDER}; give the path of that file, or add {bag.FOLDER}"
            )
        raise UserError(
            f"{path}: the recording is a folder without files of one column ({', '.join(sorted(suffixes))}); "
            "give the path of a file"
        )
    return readers.by_length(vectors)
