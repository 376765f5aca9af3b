"""Equations of vehicles, tyres and effects: ``harness.models``. Imports SymPy, NumPy and ``harness.common`` only."""

if __name__ != "harness.models":  # a second copy would have classes of its own, equal to none of the first
    raise ImportError(
        f"'{__name__}' is the package harness.models: write `from harness.models.contracts import ...`", name=__name__
    )
