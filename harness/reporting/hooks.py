"""Hooks of reports: what other packages add to its reports, such as ``reproductions`` in a checkout.

A package declares its functions as entry points in the group ``harness.reports``. Those called

* ``study``, ``(analysis)``, return sections for the first page of a study's report;
* ``times``, ``(times, folder)``, return them for the report of ``harness realtime``;
* ``campaign``, ``(results, out)``, write the report of all finished studies and return its files.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from harness.reporting.document import Block

GROUP = "harness.reports"


def hooks(name: str) -> list[Callable[..., Any]]:
    """Return the functions of a name, in the order of the packages that declare them."""
    from importlib.metadata import entry_points  # which brings the package email with it

    return [point.load() for point in entry_points(group=GROUP, name=name)]


def first_page(name: str, *result: Any) -> list[Block]:
    """Return what the hooks of a name add to the first page of the report of a result."""
    return [block for hook in hooks(name) for block in hook(*result)]
