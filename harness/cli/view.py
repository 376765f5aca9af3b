"""``harness view``: results as a local web page."""

from __future__ import annotations

import webbrowser
from pathlib import Path
from typing import Annotated

import typer
from rich.console import Console
from rich.text import Text

from harness.common.errors import UserError
from harness.common.stages import showing


def view(
    folders: Annotated[
        list[Path],
        typer.Argument(metavar="FOLDER...", help="Result folder, a folder of several, or several studies."),
    ],
    study: Annotated[
        Path | None,
        typer.Option("--study", help="Study file of the result, if recordings or networks lie beside it."),
    ] = None,
    port: Annotated[int, typer.Option("--port", min=0, max=65535, help="Port; a free one if absent.")] = 0,
    browser: Annotated[bool, typer.Option(help="Open the page in the browser.")] = True,
) -> None:
    """Walk through results in the browser: a study, several side by side, a trace, an identification or a check.

    The page is for one browser on this machine: the address opens once. In a study
    a click on a box computes the run again from its seeds; nothing is written to the folder.
    """
    try:
        import bokeh  # noqa: F401
    except ImportError:
        raise UserError("harness view needs Bokeh: pip install 'robustness-harness[view]'") from None
    from harness.common.files import refuse_url
    from harness.view.pages import pages
    from harness.view.server import Page

    for folder in folders:
        refuse_url(folder)
    console = Console(stderr=True)
    with showing(console, "reading the results and building the models"):
        page = Page(pages(folders, study), port)
    Console().print(Text(page.address), soft_wrap=True)
    console.print("Ctrl-C ends it")
    if browser:
        webbrowser.open(page.address)
    try:
        page.serve()
    except KeyboardInterrupt:
        console.print("ended")
