"""Zarr stores of results, opened here alone: version 3 of the format, numbers and texts, plain files of their own.

Version 2 lets metadata name any filter, ``pickle`` among them, which runs what it reads; and a folder that somebody
has prepared may hold links that lead out of it, or pipes that never answer. Nothing of that is read, nor written
through.
"""

from __future__ import annotations

import json
import logging
import re
import warnings
from collections.abc import Iterable
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

import zarr
from zarr.abc.store import Store
from zarr.storage import FsspecStore, LocalStore, WrapperStore

from harness.common.errors import UserError
from harness.common.places import is_url, refuse_links

if TYPE_CHECKING:
    import xarray as xr

FORMAT: Literal[3] = 3

_TYPES = re.compile(r"bool|u?int(8|16|32|64)|float(16|32|64)|string|fixed_length_utf32|variable_length_utf8")
"""Types of an array that a result holds; any other may decode to objects."""


def _is_heard(record: logging.LogRecord) -> bool:
    """Return whether a message is none on what else went wrong with a group of which one error is raised already."""
    said = record.getMessage()
    return not ("was never retrieved" in said and "zarr" in said)


logging.getLogger("asyncio").addFilter(_is_heard)


class _Plain(WrapperStore[Any]):
    """A store whose every access is looked at first."""

    def _look(self, key: str) -> None:
        root = getattr(self._store, "root", None)
        if root is not None:  # behind a URL there are no links
            refuse_links(root.parent, [f"{root.name}/{key}"])

    async def get(self, key: str, prototype: Any, byte_range: Any = None) -> Any:
        self._look(key)
        content = await super().get(key, prototype, byte_range)
        if content is not None and key.endswith("zarr.json"):
            self._refuse_objects(key, content.to_bytes())
        return content

    async def get_partial_values(self, prototype: Any, key_ranges: Iterable[tuple[str, Any]]) -> list[Any]:
        asked = list(key_ranges)
        for key, _ in asked:
            self._look(key)
        return await super().get_partial_values(prototype, asked)

    async def set(self, key: str, value: Any) -> None:
        self._look(key)
        await super().set(key, value)

    async def set_if_not_exists(self, key: str, value: Any) -> None:
        self._look(key)
        await super().set_if_not_exists(key, value)

    async def delete(self, key: str) -> None:
        self._look(key)
        await super().delete(key)

    async def delete_dir(self, prefix: str) -> None:
        self._look(prefix)
        await super().delete_dir(prefix)

    _get_many, _set_many = Store._get_many, Store._set_many  # by the methods above, one by one

    def _refuse_objects(self, key: str, metadata: bytes) -> None:
        try:
            content = json.loads(metadata)
        except ValueError:
            return  # Zarr says so
        copies = (content.get("consolidated_metadata") or {}).get("metadata", {}) if isinstance(content, dict) else {}
        for node in (content, *copies.values()):
            kind = node.get("data_type", "bool") if isinstance(node, dict) else "bool"
            name = kind.get("name") if isinstance(kind, dict) else kind
            if not _TYPES.fullmatch(str(name)):
                raise UserError(f"{self._store}/{key}: an array of type '{name}', which no result holds; do not use it")


def _opened(folder: Path, read_only: bool) -> _Plain:
    if is_url(folder):
        remote: Any = folder
        options = dict(remote.storage_options)
        return _Plain(FsspecStore.from_url(str(remote), storage_options=options, read_only=read_only))
    return _Plain(LocalStore(folder, read_only=read_only))


def group(folder: Path, path: str = "", mode: Literal["r", "r+", "w"] = "r") -> Any:
    """Return a group of a store.

    Args:
        folder: The store.
        path: Of the group within it.
        mode: ``w`` makes an empty one.

    Raises:
        UserError: If a link, a pipe or an array of objects is in its place.
        ValueError, KeyError, OSError: If there is none, or none of version 3.
    """
    # Not by the copies in the root: each group is what its own metadata say, which checksums cover.
    return zarr.open_group(
        _opened(folder, mode == "r"), path=path, mode=mode, zarr_format=FORMAT, use_consolidated=False
    )


def node(folder: Path, path: str) -> Any:
    """Return an array or a group of a store, to be read; errors as of ``group``."""
    return zarr.open(_opened(folder, True), path=path, mode="r", zarr_format=FORMAT)


def dataset(folder: Path, path: str | None = None) -> xr.Dataset:
    """Return a group of a store as a dataset whose arrays are read when they are asked for; errors as of ``group``."""
    import xarray as xr

    options: dict[str, Any] = {"consolidated": False, "cache": False, "chunks": None, "zarr_format": FORMAT}
    return xr.open_dataset(_opened(folder, True), engine="zarr", group=path, **options)  # type: ignore[arg-type]


def write(data: xr.Dataset, folder: Path, path: str | None = None) -> None:
    """Write a dataset as a group of a store, in place of one that is there; errors as of ``group``."""
    store: Any = _opened(folder, False)
    data.to_zarr(store, group=path, mode="w", consolidated=False, zarr_format=FORMAT)


def consolidate(folder: Path) -> None:
    """Copy the metadata of all groups into those of the root; the same bits however often it is done."""
    with warnings.catch_warnings():
        # Version 3 of the format leaves these copies to the libraries; whoever ignores them reads the same.
        warnings.simplefilter("ignore", zarr.errors.ZarrUserWarning)
        zarr.consolidate_metadata(_opened(folder, False), zarr_format=FORMAT)
