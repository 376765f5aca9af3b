"""Faults planted in recordings: what ``harness check`` names and mends of them."""
