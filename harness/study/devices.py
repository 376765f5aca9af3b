"""Devices other than the processor that a study may run on, found by name among the entry points ``harness.devices``.

An entry point is a function without arguments that returns the device, a module, or raises ``UserError`` where packages
are missing. The module has

* ``check()``, which raises ``UserError`` if the device cannot be used here;
* ``name()`` of it, and ``versions()`` of the packages that compile for it;
* ``evaluator(evaluator)``: what evaluates a study there, from its ``StudyEvaluator``. It has ``evaluate(units)`` and is
  compiled like one (``harness.engine.further_processes.Compiles``).

Which estimators it runs stands in their files (``DEVICES``, ``harness/estimation/contract.py``).
"""

from __future__ import annotations

from types import ModuleType

from harness.common.errors import UserError

GROUP = "harness.devices"


def device(name: str) -> ModuleType:
    """Return a device by its name.

    Raises:
        UserError: If there is none of that name, or its packages are not installed.
    """
    from importlib.metadata import entry_points  # which brings the package email with it

    for point in entry_points(group=GROUP, name=name):
        module: ModuleType = point.load()()
        return module
    raise UserError(f"no installed package has a device '{name}'")
