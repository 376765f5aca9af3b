"""Realistic plants: a car and a semitrailer that differ from the library's models in many small ways at once."""
