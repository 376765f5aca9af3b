"""The command line: ``python -m harness`` and the script ``harness``."""

import signal
import sys


def main() -> None:
    """Run the command line; Ctrl-C while it is imported, or after its end, ends it without a traceback."""
    try:
        from harness.common.process import collect_rarely

        collect_rarely()
        from harness.cli.main import main as run

        run()
    except KeyboardInterrupt:
        sys.exit(130)
    finally:
        if signal.getsignal(signal.SIGINT) is signal.default_int_handler:
            signal.signal(signal.SIGINT, signal.SIG_DFL)  # what libraries run at exit would print one


if __name__ == "__main__":
    main()
