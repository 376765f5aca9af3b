"""Unmodelled disturbances in the innovations, after the effects with a name: place, time and dependence."""
