"""The server of ``harness view``: pages for one reader on this machine.

It listens on 127.0.0.1 alone. Every address begins with a random token, and a request or websocket that names another
host is refused, so that neither another page in the same browser (by a name that leads to 127.0.0.1) nor another user
of the machine gets to it. Whatever the page needs comes from the installed package.
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

    def initialize(self, status: int) -> None:
        self._wanted = status

    def prepare(self) -> None:
        self.set_status(self._wanted)
        self.finish()


class _LocalOnly(BokehTornado):
    """Answers requests for this host, with this token, and no others."""

    def __init__(self, apps: dict[str, Application], token: str, host: str) -> None:
        self._token, self._host = token, host
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
        if not hmac.compare_digest(first.encode(), self._token.encode()):
            return self.get_handler_delegate(request, _Refused, {"status": 404})
        return super().find_handler(request, **further)

    def log_request(self, handler: RequestHandler) -> None:
        """Keep addresses, which hold the token, out of the log."""


class Page:
    """Pages that are being served.

    Args:
        build: What puts a page into a document, by its place below the address; that of ``/`` is the first one. Called
            for each reader.
        port: 0 takes one that is free.

    Attributes:
        address: Where it is, with the token.
    """

    def __init__(self, build: Mapping[str, Callable[[Document], None]], port: int = 0) -> None:
        logging.getLogger("bokeh").setLevel(logging.ERROR)
        warnings.filterwarnings("ignore", module="bokeh")
        sockets = bind_sockets(port, HOST)
        host, token = f"{HOST}:{sockets[0].getsockname()[1]}", secrets.token_urlsafe(24)
        apps = {place: Application(FunctionHandler(put)) for place, put in build.items()}
        app = _LocalOnly(apps, token, host)
        http = HTTPServer(app)
        http.add_sockets(sockets)
        self.address, self._loop = f"http://{host}/{token}/", IOLoop.current()
        self._server = BaseServer(self._loop, app, http)

    def serve(self) -> None:
        """Answer until interrupted, or until ``stop``."""
        self._server.start()
        self._loop.start()
        self._server.stop()

    def stop(self) -> None:
        """End ``serve``, from any thread."""
        self._loop.add_callback(self._loop.stop)
