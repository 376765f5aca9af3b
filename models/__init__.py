"""Equations of vehicles, tyres and effects. Imports SymPy and NumPy, and nothing from ``harness``."""
