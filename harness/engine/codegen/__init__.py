"""Derivatives of a model and the source text of its kernels."""
