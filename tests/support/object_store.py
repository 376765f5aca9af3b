"""An object store on this machine, as moto plays one."""

import contextlib
import logging
import os
import uuid
from contextlib import contextmanager

from harness.common.places import contents, names, place
from harness.study.store import STORE


@contextmanager
def s3():
    """Give the URL of a new bucket."""
    from moto.server import ThreadedMotoServer

    logging.getLogger("werkzeug").setLevel(logging.ERROR)
    server = ThreadedMotoServer(ip_address="127.0.0.1", port=0, verbose=False)
    server.start()
    host, port = server.get_host_and_port()
    new = {
        "AWS_ENDPOINT_URL": f"http://{host}:{port}",
        "AWS_ACCESS_KEY_ID": "test",
        "AWS_SECRET_ACCESS_KEY": "test",
        "AWS_DEFAULT_REGION": "us-east-1",
    }
    before = {key: os.environ.get(key) for key in new}
    os.environ.update(new)
    try:
        url = f"s3://{uuid.uuid4().hex}"
        place(url).fs.mkdir(url)
        yield url
    finally:
        for key, value in before.items():
            os.environ.pop(key)
            with contextlib.suppress(TypeError):
                os.environ[key] = value
        server.stop()


def bits(url):
    """Return every file of a store behind a URL by its name."""
    root = place(url) / STORE
    return dict(zip(names(root), contents(root, names(root)), strict=True))
