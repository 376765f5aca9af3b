"""Only who has the address gets the page, and only by the name of this machine."""

import asyncio
from urllib.parse import urlsplit

import pytest
from tornado.httpclient import HTTPClientError, HTTPRequest
from tornado.websocket import websocket_connect
from typer.testing import CliRunner

from harness.cli.main import app
from support.page_served import asked, entered, served


@pytest.fixture(scope="module")
def inside(address):
    """Where the address leads, and the header of the browser that opened it first."""
    found, name, value = entered(address)
    return found, {"Cookie": f"{name}={value}"}


def test_the_page_loads_nothing_from_elsewhere_and_tells_its_address_to_nobody(inside):
    address, cookie = inside
    status, headers, text = asked(address, urlsplit(address).path, **cookie)
    assert status == 200
    assert "default-src 'none'" in headers["Content-Security-Policy"]
    assert f"connect-src 'self' ws://{urlsplit(address).netloc};" in headers["Content-Security-Policy"]
    assert headers["Referrer-Policy"] == "no-referrer"
    assert "https://" not in text
    assert "<script>window.hit" not in text


@pytest.mark.parametrize("path", ["/", "/wrong/", "/static/js/bokeh.min.js", "/favicon.ico", "/wrong/ws"])
def test_a_wrong_token_is_refused(inside, path):
    address, cookie = inside
    assert asked(address, path, **cookie)[0] == 404


def test_the_address_that_a_browser_is_started_with_opens_once_and_gives_a_cookie(folder):
    """Any user of the machine reads it in the list of processes."""
    with served(folder) as address:
        status, headers, _ = asked(address, f"{urlsplit(address).path}1?run=0.0")
        assert status == 303
        assert headers["Location"].endswith("/1?run=0.0")
        place = headers["Location"].removesuffix("1?run=0.0")
        assert urlsplit(address).path not in place
        cookie, *attributes = headers["Set-Cookie"].split("; ")
        assert {f"Path={place}", "HttpOnly", "SameSite=Strict"} <= set(attributes)
        status, headers, said = asked(address, urlsplit(address).path, Cookie=cookie)
        assert (status, headers.get("Set-Cookie")) == (410, None)
        assert "opened before" in said
        for path in (place, f"{place}ws", f"{place}static/js/bokeh.min.js"):
            assert asked(address, path)[0] == 403
            assert asked(address, path, Cookie=f"{cookie}x")[0] == 403
        assert asked(address, place, Cookie=cookie)[0] == 200


def test_the_browser_is_started_with_that_address(monkeypatch, folder):
    opened = []
    monkeypatch.setattr("webbrowser.open", opened.append)
    monkeypatch.setattr("harness.view.server.Page.serve", lambda page: opened.append(page.address))
    said = CliRunner().invoke(app, ["view", str(folder)]).output
    assert opened[0] == opened[1]
    assert opened[0] in said.splitlines()


@pytest.mark.parametrize("host", ["evil.example", "localhost:5006", "127.0.0.1", ""])
def test_another_host_is_refused(inside, host):
    address, cookie = inside
    assert asked(address, urlsplit(address).path, Host=host, **cookie)[0] in (400, 403)


@pytest.mark.parametrize(
    ("origin", "token"), [("http://evil.example", True), ("http://127.0.0.1:1", True), ("", False)]
)
def test_a_websocket_from_elsewhere_is_refused(inside, origin, token):
    address, cookie = inside
    parts = urlsplit(address)
    path = parts.path if token else "/wrong/"
    request = HTTPRequest(
        f"ws://{parts.netloc}{path}ws", headers={"Origin": origin or f"http://{parts.netloc}", **cookie}
    )

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
