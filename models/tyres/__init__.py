"""Tyres: one file each gives an axle's steady lateral force."""
