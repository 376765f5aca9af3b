"""The one exception for bad input: its message says what is wrong, where, and how to mend it."""

from __future__ import annotations


class UserError(Exception):
    """A request that cannot be carried out as stated; the command line shows the message and exits with 2."""
