"""Kernels printed as C99, one number in each lane."""
