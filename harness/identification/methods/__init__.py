"""One method of identification per file, see ``harness.identification.contract``."""
