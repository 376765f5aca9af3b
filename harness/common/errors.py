"""The exceptions for bad input: their messages say what is wrong, where, and how to mend it."""

from __future__ import annotations


class UserError(Exception):
    """A request that cannot be carried out as stated; the command line shows the message and exits with 2."""


class ModelError(ValueError):
    """A model, parameter or drive that cannot be built; the message says what, where and how to mend it."""
