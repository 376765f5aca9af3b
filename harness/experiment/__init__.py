"""Experiment design: the drives that tell most of what a fit or a trace left open."""
