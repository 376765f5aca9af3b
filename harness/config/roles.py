"""The role of estimators, whose settings a study states."""

from __future__ import annotations

from harness.common.registry import Role

ESTIMATORS = Role(
    "harness.estimation.methods",  # by name, since it stands above; nothing loads if it is not there
    "estimator",
    ("workspace", "step"),
    "harness/estimation/contract.py",
    "estimators",
    "filter_of",
)
