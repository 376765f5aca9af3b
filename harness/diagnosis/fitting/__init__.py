"""Fit parameters and noise of the augmented model to the drives."""
