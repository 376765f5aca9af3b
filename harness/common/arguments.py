"""The words of modules that run outside the command line; that one refuses the same by itself."""

from __future__ import annotations

import argparse
from typing import Any


class Parser(argparse.ArgumentParser):
    """Refuses an option that is given twice, of which argparse takes the last without a word."""

    def __init__(self, *args: Any, **kwargs: Any) -> None:
        super().__init__(*args, **kwargs)
        self.given: set[str] = set()
        for name in (None, "store"):
            self.register("action", name, _Once)

    def parse_known_args(self, args: Any = None, namespace: Any = None) -> Any:
        """Read the words of a command; those before are forgotten."""
        self.given = set()
        return super().parse_known_args(args, namespace)


class _Once(argparse.Action):
    """Stores a value."""

    def __call__(self, parser: Any, namespace: Any, values: Any, option_string: str | None = None) -> None:
        if self.option_strings and self.dest in parser.given:
            parser.error(f"argument {option_string}: is given twice; give it once")
        parser.given.add(self.dest)
        setattr(namespace, self.dest, values)
