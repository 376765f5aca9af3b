"""Whether the signals of a recording agree, what explains where they do not, and what mends it: harness check."""
