"""Robustness of vehicle state estimators, and what a model lacks: one package per stage (docs/structure.md)."""

from harness.common.components import register

__all__ = ["register"]
