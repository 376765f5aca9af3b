"""The proof of ``harness trace``: cases of the blind plant, traced, and only then opened and scored."""
