"""One method of identification per file, see ``harness.identify.contract``."""
