"""The page of ``harness view`` served, and opened as a browser does: its address gives a cookie, once, and leads on."""

import contextlib
import functools
import http.client
import os
import subprocess
import sys
from http.cookies import SimpleCookie
from pathlib import Path
from urllib.parse import urlsplit


def asked(address, path, **headers):
    """Return status, headers and text of the answer to a request."""
    connection = http.client.HTTPConnection(urlsplit(address).netloc, timeout=60)
    try:
        connection.request("GET", path, headers=headers)
        answer = connection.getresponse()
        return answer.status, dict(answer.getheaders()), answer.read().decode()
    finally:
        connection.close()


@contextlib.contextmanager
def served(*folders):
    """Serve the page of result folders as a user does, and give its address."""
    command = [sys.executable, "-m", "harness", "view", *map(str, folders), "--no-browser"]
    root = str(Path(__file__).parents[2])
    environment = os.environ | {"PYTHONPATH": root}
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True, env=environment) as process:
        try:
            yield process.stdout.readline().strip()
        finally:
            process.terminate()


@functools.cache
def entered(address):
    """Return where an address leads that is opened for the first time, and the cookie, by name and value."""
    status, headers, _ = asked(address, urlsplit(address).path)
    assert status == 303
    ((name, morsel),) = SimpleCookie(headers["Set-Cookie"]).items()
    return f"http://{urlsplit(address).netloc}{headers['Location']}", name, morsel.value
