"""Studies of the methods on simulated recordings, each a command: ``python -m harness.reproductions.<name>``."""
