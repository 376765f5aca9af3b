"""The server of ``harness view``: pages for one reader on this machine.

It listens on 127.0.0.1 alone. A request or websocket that names another host is refused, so that no other page in the
same browser gets to it by a name that leads to 127.0.0.1. Every address begins with a random token and is answered only
with a cookie, which one browser gets: the first that opens the address that a browser is started with. Other users of
the machine, who read that address in the list of processes, come too late. Whatever the page needs comes from the
installed package.
"""

from __future__ import annotations

import hmac
import logging
import secrets
import warnings
from collections.abc import Callable, Mapping
from typing import Any

from bokeh.application import Application
from bokeh.application.handlers.function import FunctionHandler
from bokeh.document import Document
from bokeh.server.server import BaseServer
from bokeh.server.tornado import BokehTornado
from tornado.httpserver import HTTPServer
from tornado.httputil import HTTPHeaders, HTTPServerRequest
from tornado.ioloop import IOLoop
from tornado.netutil import bind_sockets
from tornado.web import OutputTransform, RequestHandler

HOST = "127.0.0.1"

HEADERS = {
    "Content-Security-Policy": "default-src 'none'; script-src 'self' 'unsafe-inline' 'unsafe-eval'; "
    "style-src 'self' 'unsafe-inline'; img-src 'self' data: blob:; font-src 'self' data:; "
    "connect-src 'self' ws://{host}; base-uri 'none'; form-action 'none'; frame-ancestors 'none'",
    "Referrer-Policy": "no-referrer",
    "X-Content-Type-Options": "nosniff",
    "Cache-Control": "no-store",
}
"""Sent with every answer: nothing is loaded from elsewhere, and the token is told to nobody. Bokeh makes functions of
text that this package sends, hence ``unsafe-eval``; no name of a study is ever part of such a text."""


class _Headers(OutputTransform):
    """Adds them to every answer."""

    def __init__(self, request: HTTPServerRequest) -> None:
        self._host = request.host

    def transform_first_chunk(
        self, status_code: int, headers: HTTPHeaders, chunk: bytes, finishing: bool
    ) -> tuple[int, HTTPHeaders, bytes]:
        """Add them before anything is sent."""
        for name, text in HEADERS.items():
            headers[name] = text.format(host=self._host)
        return status_code, headers, chunk


class _Refused(RequestHandler):
    """Says no more than that."""

    def initialize(self, status: int, words: str = "") -> None:
        self._wanted, self._words = status, words

    def prepare(self) -> None:
        self.set_status(self._wanted)
        self.set_header("Content-Type", "text/plain; charset=utf-8")
        self.finish(self._words)


_USED = (
    "This address was opened before, and it opens once. If that was not you, end harness view (Ctrl-C): somebody else "
    "on this machine looks at its page. For another browser start harness view again."
)


class _Opened(RequestHandler):
    """Gives the browser its cookie and leads on."""

    def initialize(self, name: str, value: str, token: str) -> None:
        self._cookie, self._to = (name, value), token

    def get(self) -> None:
        """Lead to the page, with all that the address says of it."""
        name, value = self._cookie
        self.set_cookie(name, value, path=f"/{self._to}/", httponly=True, samesite="Strict")
        rest = self.request.path.lstrip("/").partition("/")[2]
        query = f"?{self.request.query}" if self.request.query else ""
        self.redirect(f"/{self._to}/{rest}{query}", status=303)


class _LocalOnly(BokehTornado):
    """Answers requests for this host, with this token and its cookie, and no others.

    Attributes:
        once: Place that gives the cookie, to the first who asks for it.
    """

    def __init__(self, apps: dict[str, Application], host: str) -> None:
        token, self.once, self._secret = (secrets.token_urlsafe(24) for _ in range(3))
        self._token, self._host, self._is_open = token, host, True
        self._cookie = f"harness-{host.rpartition(':')[2]}"  # browsers send those of all ports
        super().__init__(
            apps,
            prefix=f"/{token}",
            extra_websocket_origins=[host],
            use_index=False,
            transforms=[_Headers],
        )

    def find_handler(self, request: HTTPServerRequest, **further: Any) -> Any:
        """Refuse before anything is looked up."""
        first = request.path.lstrip("/").partition("/")[0]
        if request.headers.get("Host", "").lower() != self._host:
            return self.get_handler_delegate(request, _Refused, {"status": 403})
        if _same(first, self.once):
            if not self._is_open:
                return self.get_handler_delegate(request, _Refused, {"status": 410, "words": _USED})
            self._is_open = request.method != "GET"
            given = {"name": self._cookie, "value": self._secret, "token": self._token}
            return self.get_handler_delegate(request, _Opened, given)
        if not _same(first, self._token):
            return self.get_handler_delegate(request, _Refused, {"status": 404})
        cookie = request.cookies.get(self._cookie)
        if cookie is None or not _same(cookie.value, self._secret):
            return self.get_handler_delegate(request, _Refused, {"status": 403})
        return super().find_handler(request, **further)

    def log_request(self, handler: RequestHandler) -> None:
        """Keep addresses, which hold the token, out of the log."""


def _same(first: str, second: str) -> bool:
    return hmac.compare_digest(first.encode(), second.encode())


class Page:
    """Pages that are being served.

    Args:
        build: What puts a page into a document, by its place below the address; that of ``/`` is the first one. Called
            for each reader.
        port: 0 takes one that is free.

    Attributes:
        address: Where it is; it opens in one browser, the first.
    """

    def __init__(self, build: Mapping[str, Callable[[Document], None]], port: int = 0) -> None:
        logging.getLogger("bokeh").setLevel(logging.ERROR)
        warnings.filterwarnings("ignore", module="bokeh")
        sockets = bind_sockets(port, HOST)
        host = f"{HOST}:{sockets[0].getsockname()[1]}"
        apps = {place: Application(FunctionHandler(put)) for place, put in build.items()}
        app = _LocalOnly(apps, host)
        http = HTTPServer(app)
        http.add_sockets(sockets)
        self.address, self._loop = f"http://{host}/{app.once}/", IOLoop.current()
        self._server = BaseServer(self._loop, app, http)

    def serve(self) -> None:
        """Answer until interrupted, or until ``stop``."""
        self._server.start()
        self._loop.start()
        self._server.stop()

    def stop(self) -> None:
        """End ``serve``, from any thread."""
        self._loop.add_callback(self._loop.stop)
