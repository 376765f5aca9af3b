"""Drives, and vehicles that drive them."""
