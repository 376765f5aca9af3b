"""Interactive HTML of reports: numbers on hover, series on and off, scales, sorted tables.

All of it works in the one file, without a server and without anything loaded from elsewhere. Without scripts the page
is what it is on paper. A content security policy allows the one script below and no other, so that no name in a study
can become code.
"""

from __future__ import annotations

import base64
import hashlib
import html
import re
from pathlib import Path

_IMAGE = re.compile(r'<img src="data:image/svg\+xml;base64,([^"]+)" alt="([^"]*)"[^>]*>')
_HEAD = re.compile(r"^.*?(?=<svg)|<metadata>.*?</metadata>|<style[^>]*>.*?</style>", re.DOTALL)
_SIZE = re.compile(r'(<svg [^>]*?)width="[^"]*" height="[^"]*" ')
_NEEDED = re.compile(r'(?:href="#|url\(#)([^")]+)')


def page(text: str) -> bytes:
    """Return the HTML of a report that typst wrote with its style, its script and its figures in place.

    Args:
        text: From typst.
    """
    here = Path(__file__).parent
    css = "".join((here / name).read_text(encoding="utf-8") for name in ("page.css", "rolled.css"))
    scripts = [(here / name).read_text(encoding="utf-8") for name in ("tables.js", "axes.js", "page.js")]
    script = '"use strict";\n' + "".join(scripts)
    head, mark, rest = text.partition("</head>")
    if not mark:
        raise RuntimeError("typst wrote HTML without a head")
    body, end, rest = rest.rpartition("</body>")
    number = 0

    def drawn(match: re.Match[str]) -> str:
        nonlocal number
        number += 1
        return _inline(base64.b64decode(match[1]).decode("utf-8"), html.unescape(match[2]), f"f{number}-")

    allowed = base64.b64encode(hashlib.sha256(script.encode()).digest()).decode()
    policy = f"default-src 'none'; img-src data:; style-src 'unsafe-inline'; script-src 'sha256-{allowed}'"
    meta = f'<meta http-equiv="Content-Security-Policy" content="{policy}">'
    whole = f"{head}{meta}<style>{css}</style>{mark}{_IMAGE.sub(drawn, body)}<script>{script}</script>{end}{rest}"
    return whole.encode()


def _inline(svg: str, alt: str, prefix: str) -> str:
    """Return a figure as an element of the page: what it names is named apart from what other figures name."""
    svg = _SIZE.sub(r"\1", _HEAD.sub("", svg), count=1)
    needed = set(_NEEDED.findall(svg))
    svg = re.sub(r' id="([^"]*)"', lambda m: f' id="{prefix}{m[1]}"' if m[1] in needed else "", svg)
    svg = re.sub(r'(href="#|url\(#)', rf"\g<1>{prefix}", svg)
    return svg.strip().replace("<svg ", f'<svg role="img" aria-label="{html.escape(alt)}" ', 1)
