"""Only who has the address gets the page, and only by the name of this machine."""

import asyncio
import http.client
from urllib.parse import urlsplit

import pytest
from tornado.httpclient import HTTPClientError, HTTPRequest
from tornado.websocket import websocket_connect
from typer.testing import CliRunner

from harness.cli.main import app


def asked(address, path, **headers):
    """Return status and headers of the answer to a request."""
    connection = http.client.HTTPConnection(urlsplit(address).netloc, timeout=60)
    try:
        connection.request("GET", path, headers=headers)
        answer = connection.getresponse()
        return answer.status, dict(answer.getheaders()), answer.read().decode()
    finally:
        connection.close()


def test_the_page_loads_nothing_from_elsewhere_and_tells_its_address_to_nobody(address):
    status, headers, text = asked(address, urlsplit(address).path)
    assert status == 200
    assert "default-src 'none'" in headers["Content-Security-Policy"]
    assert f"connect-src 'self' ws://{urlsplit(address).netloc};" in headers["Content-Security-Policy"]
    assert headers["Referrer-Policy"] == "no-referrer"
    assert "https://" not in text
    assert "<script>window.hit" not in text


@pytest.mark.parametrize("path", ["/", "/wrong/", "/static/js/bokeh.min.js", "/favicon.ico", "/wrong/ws"])
def test_a_wrong_token_is_refused(address, path):
    assert asked(address, path)[0] == 404


@pytest.mark.parametrize("host", ["evil.example", "localhost:5006", "127.0.0.1", ""])
def test_another_host_is_refused(address, host):
    assert asked(address, urlsplit(address).path, Host=host)[0] in (400, 403)


@pytest.mark.parametrize(
    ("origin", "token"), [("http://evil.example", True), ("http://127.0.0.1:1", True), ("", False)]
)
def test_a_websocket_from_elsewhere_is_refused(address, origin, token):
    parts = urlsplit(address)
    path = parts.path if token else "/wrong/"
    request = HTTPRequest(f"ws://{parts.netloc}{path}ws", headers={"Origin": origin or f"http://{parts.netloc}"})

    async def connect():
        await websocket_connect(request, subprotocols=["bokeh", "none"])

    with pytest.raises(HTTPClientError) as refused:
        asyncio.run(connect())
    assert refused.value.code in (403, 404)


def test_without_bokeh_it_says_how_to_get_it(monkeypatch, tmp_path):
    monkeypatch.setitem(__import__("sys").modules, "bokeh", None)
    result = CliRunner().invoke(app, ["view", str(tmp_path)])
    assert result.exit_code == 2
    assert "pip install 'robustness-harness[view]'" in result.output


def test_without_a_result_it_says_so(tmp_path):
    result = CliRunner().invoke(app, ["view", str(tmp_path), "--no-browser"])
    assert result.exit_code == 2
    assert "no result to show" in result.output
