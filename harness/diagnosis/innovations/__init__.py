"""Disturbances as they enter the innovations of the filter."""
