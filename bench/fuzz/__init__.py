"""Broken input by the hundred thousand: every outcome is a result or one clear error (``make fuzz``)."""
