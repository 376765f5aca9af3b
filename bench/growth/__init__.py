"""How time and memory grow with runs, drive length, states, particles and workers: ``python -m bench.growth``."""
