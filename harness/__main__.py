"""The command line: ``python -m harness`` and the script ``harness``."""

import sys


def main() -> None:
    """Run the command line; Ctrl-C while it is imported ends it without a traceback."""
    try:
        from harness.common.process import collect_rarely

        collect_rarely()
        from harness.cli.main import main as run

        run()
    except KeyboardInterrupt:
        sys.exit(130)


if __name__ == "__main__":
    main()
