"""What the tests of the report share: reading its files, and ways in which runs get lost."""

from __future__ import annotations

import re
from html.parser import HTMLParser

import numpy as np

ANGLE = {"articulation_angle": ("rad", 0.012)}


class Page(HTMLParser):
    """Text, links and tags of an HTML page."""

    def __init__(self, html: str):
        super().__init__()
        self.words: list[str] = []
        self.links: list[str] = []
        self.tags: list[str] = []
        self.feed(html)

    def handle_starttag(self, tag, attrs):
        self.tags.append(tag)
        self.links += [value for key, value in attrs if key in ("src", "href") and value]

    def handle_data(self, data):
        self.words.append(data)

    @property
    def text(self) -> str:
        return " ".join("".join(self.words).split())


def pages(pdf: bytes) -> int:
    """Page count of a PDF; Typst writes the page tree as plain text."""
    counts = re.findall(rb"/Type /Pages\s*/Count (\d+)", pdf) or re.findall(rb"/Count (\d+)", pdf)
    return max(int(c) for c in counts)


def lose_some(fates: np.ndarray) -> None:
    """Plant lost in 3 runs, UKF in 4 more, all at 8 t; EKF in one at 32 t."""
    fates[0, 0, 5, :3, :] = 2
    fates[0, 0, 4, :4, 1] = 1
    fates[6, 0, 3, 0, 0] = 1


def everything_at_8_t(fates: np.ndarray) -> None:
    fates[0] = 1


def everything(fates: np.ndarray) -> None:
    fates[...] = 2
