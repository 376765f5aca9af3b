"""What the sources publish, computed again: each a command, ``python -m reproductions.<name>``."""
