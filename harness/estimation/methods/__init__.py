"""Estimators: one file each, all through the contract of ``harness.estimation.contract``."""
