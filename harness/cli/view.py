"""``harness view``: a finished study as a local web page."""

from __future__ import annotations

import webbrowser
from pathlib import Path
from typing import Annotated

import typer
from rich.console import Console
from rich.text import Text

from harness.common.errors import UserError


def view(
    folder: Annotated[Path, typer.Argument(help="Result folder of a finished study.")],
    study: Annotated[
        Path | None,
        typer.Option("--study", help="Study file of the result, if files that it names lie beside it."),
    ] = None,
    port: Annotated[int, typer.Option("--port", min=0, max=65535, help="Port; a free one if absent.")] = 0,
    browser: Annotated[bool, typer.Option(help="Open the page in the browser.")] = True,
) -> None:
    """Walk through the results of a study in the browser: from a box to the run.

    The page is for this machine alone, and its address holds a token.
    A click on a box computes the run again from its seeds; nothing is written to the folder.
    """
    try:
        import bokeh  # noqa: F401
    except ImportError:
        raise UserError("harness view needs Bokeh: pip install 'robustness-harness[view]'") from None
    from harness.study.report import analyse
    from harness.study.view.run_panel import Runs
    from harness.study.view.server import Page
    from harness.study.view.study_page import build

    console = Console(stderr=True)
    with console.status("reading the results and building the models"):
        analysis = analyse(folder)
        runs = Runs(folder, None if study is None else study.parent)
        page = Page(build(analysis, runs), port)
    Console().print(Text(page.address), soft_wrap=True)
    console.print("Ctrl-C ends it")
    if browser:
        webbrowser.open(page.address)
    try:
        page.serve()
    except KeyboardInterrupt:
        console.print("ended")
