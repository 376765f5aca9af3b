"""Published results of the sources, computed again: each a command, ``python -m reproductions.<name>``."""
