"""Readers of measured data: one format per file."""
