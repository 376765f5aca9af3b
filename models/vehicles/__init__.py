"""Vehicles: one file each states the differential equations once."""
