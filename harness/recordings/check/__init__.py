"""Consistency check of a recording: comparisons of its signals, their explanation, and a mended map: harness check."""
