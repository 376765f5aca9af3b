"""Signals and roads estimated from noisy samples: smoothing, causal filters, and the bank of the road."""
