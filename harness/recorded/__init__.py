"""Estimators on recordings, and their noise from the innovations, where nobody knows the true state."""
