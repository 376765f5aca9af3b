"""The filter around the model with every effect that may be missing."""
