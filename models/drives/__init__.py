"""Drives: one file each turns options into steering and speed over time."""
