"""A lock on a folder behind a URL, where no operating system takes back what a killed process held.

Its holder writes the object again and again. Whoever finds it watches it: if it changes, its holder is at work; if it
does not for three times as long as its holder may take, the holder is gone, and the lock is taken over. No clock is
compared with another. A holder that comes back, such as a laptop that was closed, finds that it has lost the lock
and stops.
"""

from __future__ import annotations

import contextlib
import json
import threading
import time
import uuid
from collections.abc import Callable, Iterator
from pathlib import Path

from harness.common import places
from harness.common.errors import UserError, WorkError

RENEWED = 10.0
"""s between two signs of life."""

WATCHED = 3 * RENEWED
"""s without one after which a holder counts as gone."""

_LOOK = 0.1
"""Time between two looks, over that for which is watched."""


class Lease:
    """A lock that is held by renewing it.

    Args:
        file: The object.
        words: Who holds it, and for what.
        say: Takes what a user should know while this takes time.

    Raises:
        UserError: If somebody else holds it.
    """

    def __init__(self, file: Path, words: str, say: Callable[[str], None]) -> None:
        self._file, self._words, self._token = file, words, uuid.uuid4().hex
        self._lost, self._beats, self._ended = "", 0, threading.Event()
        if (content := _content(file)) is not None:
            self._take_over(content, say)
        if not places.created(file, self._content()):
            raise self._held(_content(file))
        self._thread = threading.Thread(target=self._renew, daemon=True, name="lease")
        self._thread.start()

    def check(self) -> None:
        """Raise an error if the lock was lost.

        Raises:
            WorkError: If another process has taken it over.
        """
        if self._lost:
            raise WorkError(
                f"{self._file.parent} was taken over by another process while this one did not answer: {self._lost}; "
                "what is finished is kept"
            )

    def end(self) -> None:
        """Give the lock back."""
        self._ended.set()
        self._thread.join()
        with contextlib.suppress(Exception):  # the work is done; whoever comes next waits for half a minute
            if _token(_content(self._file)) == self._token:
                self._file.unlink(missing_ok=True)

    def _take_over(self, content: bytes, say: Callable[[str], None]) -> None:
        """Watch a lock that was found, and delete it if nobody renews it."""
        who = _said(content)
        say(f"{self._file.parent} is held: {who}; watching for up to {WATCHED:.0f} s whether that is still at work")
        until = time.monotonic() + WATCHED
        while time.monotonic() < until:
            time.sleep(_LOOK * WATCHED)
            now = _content(self._file)
            if now is None:
                return
            if now != content:
                raise self._held(now)
        say("it is not: the folder is taken over")
        self._file.unlink(missing_ok=True)

    def _held(self, content: bytes | None) -> UserError:
        return UserError(
            f"{self._file.parent} is being written by another process: {_said(content)}; wait for it or stop it, or "
            "choose another folder with --out"
        )

    def _renew(self) -> None:
        while not self._ended.wait(RENEWED):
            with contextlib.suppress(Exception):  # out of reach for a moment: tried again
                content = _content(self._file)
                if content is not None and _token(content) != self._token:
                    self._lost = _said(content)
                    return
                self._beats += 1
                places.write(self._file, self._content())

    def _content(self) -> bytes:
        return json.dumps({"words": self._words, "token": self._token, "beats": self._beats}).encode()


@contextlib.contextmanager
def leased(file: Path, words: str, say: Callable[[str], None]) -> Iterator[Lease]:
    """Hold a lock behind a URL while the block runs; see ``Lease``."""
    lease = Lease(file, words, say)
    try:
        yield lease
    finally:
        lease.end()


def holder(file: Path) -> str | None:
    """Return who holds a lock behind a URL, and when it was renewed last; ``None`` for nobody."""
    content = _content(file)
    if content is None:
        return None
    return f"{_said(content)}, renewed {max(time.time() - places.time_of(file), 0.0):.0f} s ago"


def _content(file: Path) -> bytes | None:
    return places.contents(file.parent, [file.name])[0]


def _token(content: bytes | None) -> str | None:
    try:
        return str(json.loads(content or b"{}")["token"])
    except (ValueError, KeyError, TypeError):
        return None


def _said(content: bytes | None) -> str:
    try:
        return str(json.loads(content or b"{}")["words"])
    except (ValueError, KeyError, TypeError):
        return "it does not say which"
