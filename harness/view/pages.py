"""Choice of the page of a result folder, by the files that its command wrote."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from importlib import import_module
from pathlib import Path

from bokeh.document import Document

from harness.common.errors import UserError
from harness.view import folder_page

Put = Callable[[Document], None]

KINDS: dict[str, str] = {
    "scores.zarr": "study",
    "trace.json": "trace",
    "identify.json": "identification",
    "check.json": "check",
    "campaign.json": "campaign",
}
"""What a folder holds, by the file that says it."""


def kind_of(folder: Path) -> str | None:
    """Return what a result folder holds; ``None`` if no page shows it."""
    return next((kind for file, kind in KINDS.items() if (folder / file).exists()), None)


def pages(folders: Sequence[Path], study: Path | None = None) -> dict[str, Put]:
    """Return the pages of one result folder, of a folder of several, or of several studies side by side.

    Args:
        folders: One, or two and more of studies.
        study: Study file, if files that it names lie next to it.

    Returns:
        What puts a page into a document, by its place below the address; ``/`` is the first one.

    Raises:
        UserError: If a folder holds no result, or studies cannot be shown side by side.
    """
    study_folder = None if study is None else study.parent
    if len(folders) > 1:
        for i, folder in enumerate(folders):
            if kind_of(folder) != "study":
                raise UserError(f"{folder}: no study; side by side are shown studies")
            if folder.resolve() in [f.resolve() for f in folders[:i]]:
                raise UserError(f"{folder}: given twice")
        side_by_side = import_module("harness.view.side_by_side_page").build(folders)
        return {"/": side_by_side, **{f"/{i}": _later(folder, study_folder) for i, folder in enumerate(folders, 1)}}
    folder = folders[0]
    if kind_of(folder) is not None:
        return {"/": _page(folder, study_folder)}
    inner = sorted(path for path in folder.iterdir() if path.is_dir() and kind_of(path)) if folder.is_dir() else []
    if not inner:
        raise UserError(
            f"{folder}: no result to show: there is none of {', '.join(KINDS)} in it, nor in a folder in it; the "
            "commands run, trace, identify, check and campaign write them"
        )
    inner_pages = {f"/{i}": _later(path, study_folder) for i, path in enumerate(inner, 1)}
    return {"/": folder_page.of_several(folder, [(path, str(kind_of(path))) for path in inner]), **inner_pages}


def _page(folder: Path, study_folder: Path | None) -> Put:
    """Return the page of one result; what pages of another kind need is not imported."""
    module = {"study": "study_page", "trace": "trace_page", "identification": "fit_page", "check": "check_page"}
    kind = str(kind_of(folder))
    if kind == "campaign":
        return folder_page.of_campaign(folder)
    build = import_module(f"harness.view.{module[kind]}").build
    page: Put = build(folder, study_folder) if kind == "study" else build(folder)
    return page


def _later(folder: Path, study_folder: Path | None) -> Put:
    """Return a page that is read when it is opened first."""
    made: list[Put] = []

    def put(document: Document) -> None:
        if not made:
            try:
                made.append(_page(folder, study_folder))
            except UserError as error:
                made.append(folder_page.refused(folder, str(error)))
        made[0](document)

    return put
