"""Faults on purpose, and whether the same command then still gives the same bits; ``make faults``."""
