"""Estimators as C99, printed from the kernels that studies run."""
