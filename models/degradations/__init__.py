"""Degradations of sensors: what becomes of the readings behind the noise of the sensor, in the plant alone."""
