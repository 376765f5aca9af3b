"""Sensor sets: one file each says which signals are measured."""
