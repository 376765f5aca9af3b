"""Run a notebook of the tutorial in an empty folder and write it with its outputs.

``python -m bench.notebooks docs/notebooks/results.ipynb build/notebooks/results.ipynb`` does what ``make docs`` needs
of a notebook that no test has run yet.
"""

from __future__ import annotations

import tempfile
from pathlib import Path

import nbclient
import nbformat

from harness.common.arguments import Parser


def run(notebook: Path, out: Path) -> None:
    """Run a notebook from its first cell to the last, in a folder that holds nothing else, and write it.

    Raises:
        nbclient.exceptions.CellExecutionError: If a cell fails; nothing is written.
    """
    content = nbformat.read(notebook, as_version=4)
    with tempfile.TemporaryDirectory(prefix="notebook-") as folder:
        nbclient.NotebookClient(content, timeout=600, resources={"metadata": {"path": folder}}).execute()
    out.parent.mkdir(parents=True, exist_ok=True)
    nbformat.write(content, out)


def main() -> None:
    """Run and write."""
    parser = Parser(description=__doc__)
    parser.add_argument("notebook", type=Path)
    parser.add_argument("out", type=Path)
    chosen = parser.parse_args()
    run(chosen.notebook, chosen.out)


if __name__ == "__main__":
    main()
