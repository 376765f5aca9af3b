"""Main program of a worker process: makes a body from its loader, then calls its methods until nobody asks any more.

Requests and answers are pickled by ``multiprocessing.connection`` over a socket that the parent made, never over the
standard streams, which belong to the foreign code. An answer is ``("done", value)``, or ``("failed", words)`` where the
body raised an error. The first answer says whether the body could be made.
"""

from __future__ import annotations

import os
import signal
import sys
import threading
import time
from multiprocessing.connection import Connection
from typing import Any

from harness.common.errors import UserError
from harness.external import bodies


def main(handle: int) -> None:
    """Serve requests.

    Args:
        handle: Of the inherited socket.
    """
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # Ctrl-C ends the parent, which ends this
    threading.Thread(target=_end_with, args=(os.getppid(),), daemon=True).start()
    connection = Connection(handle)
    body: Any = None
    while True:
        try:
            method, arguments = connection.recv()
        except (EOFError, OSError):
            os._exit(0)  # foreign destructors have hung and crashed
        try:
            if method == "load":
                sys.path[:0] = arguments[0].get("import_from", ())
                body, answer = bodies.load(arguments[0]), None
            else:
                answer = getattr(body, method)(*arguments)
        except UserError as error:
            connection.send(("failed", str(error)))
        except KeyboardInterrupt:
            connection.send(("failed", "it raised KeyboardInterrupt"))
        except SystemExit as error:
            connection.send(("failed", f"it called sys.exit({error.code!r})"))
        except BaseException as error:
            connection.send(("failed", _words(error)))
        else:
            connection.send(("done", answer))


def _end_with(parent: int) -> None:
    """End this process when its parent is no more, also while foreign code does not return."""
    while os.getppid() == parent:
        time.sleep(1.0)
    os._exit(0)


def _words(error: BaseException) -> str:
    """Return an error of foreign code in one line, with the line of its code that raised it."""
    import traceback

    text = " ".join(str(error).split())[:500]
    frames = [f for f in traceback.extract_tb(error.__traceback__) if f"{os.sep}harness{os.sep}" not in f.filename]
    where = f" ({os.path.basename(frames[-1].filename)}, line {frames[-1].lineno})" if frames else ""
    return f"{type(error).__name__}: {text}{where}" if text else f"{type(error).__name__}{where}"


if __name__ == "__main__":
    main(int(sys.argv[1]))
