"""Growth of time and memory with runs, drive length, states, particles and workers: ``python -m bench.growth``."""
