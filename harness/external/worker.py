"""Main program of a worker process: makes a body from its loader, then calls its methods until nobody asks any more.

Requests and answers go over a socket that the parent made (``harness.external.transport``), never over the standard
streams, which belong to the foreign code. An answer is ``("done", value)``, or ``("failed", words)`` where the
body raised an error. The first answer says whether the body could be made.
"""

from __future__ import annotations

import os
import signal
import sys
from multiprocessing.connection import Connection
from typing import Any

from harness.common.errors import UserError
from harness.external import bodies
from harness.external.in_words import in_words
from harness.external.transport import receive, send


def main(handle: int, watched: int) -> None:
    """Serve requests.

    Args:
        handle: Of the inherited socket.
        watched: End of a pipe that is closed when the parent is no more.
    """
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # Ctrl-C ends the parent, which ends this
    _end_with_parent(watched)
    connection = Connection(handle)
    body: Any = None
    while True:
        try:
            method, arguments = receive(connection)
        except (EOFError, OSError):
            os._exit(0)  # foreign destructors have hung and crashed
        try:
            if method == "load":
                sys.path[:0] = arguments[0].get("import_from", ())
                body, answer = bodies.load(arguments[0]), None
            else:
                answer = getattr(body, method)(*arguments)
        except UserError as error:
            send(connection, ("failed", str(error)))
        except BaseException as error:
            send(connection, ("failed", in_words(error)))
        else:
            send(connection, ("done", answer))


def _end_with_parent(watched: int) -> None:
    """End this process, and all that it starts, when its parent is no more.

    A process of its own waits for that: while a library is loaded that does not return, no thread gets its turn.
    """
    if os.fork():
        os.close(watched)
        return
    most = os.sysconf("SC_OPEN_MAX")
    os.closerange(0, watched)  # whoever reads what the worker says must see its end
    os.closerange(watched + 1, min(most, 4096))
    os.read(watched, 1)
    os.killpg(os.getpgrp(), signal.SIGKILL)


if __name__ == "__main__":
    main(int(sys.argv[1]), int(sys.argv[2]))
