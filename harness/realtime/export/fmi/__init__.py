"""Exported C as an FMU: FMI 2.0 and 3.0, co-simulation."""
