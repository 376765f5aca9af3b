"""The study runner: one stage of the design per module."""
