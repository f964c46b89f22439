"""The command `cascadenorm`, and `python -m cascadenorm`: Ctrl-C ends in one line from the first import on."""

import os
import signal
from typing import NoReturn

INTERRUPTED = "cascadenorm: interrupted; no file was left half written\n"


def main() -> NoReturn:
    """Run the command line and exit."""
    waits = signal.getsignal(signal.SIGINT) is signal.default_int_handler  # it is ignored in the background of a shell
    if waits:
        signal.signal(signal.SIGINT, _end)
    from cascadenorm.cli import main as run_program

    if waits:
        signal.signal(signal.SIGINT, signal.default_int_handler)
    run_program()


def _end(*_: object) -> NoReturn:
    """End without a traceback, which an import that is interrupted would print."""
    os.write(2, INTERRUPTED.encode())
    os._exit(130)


if __name__ == "__main__":
    main()
