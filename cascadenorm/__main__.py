"""The command `cascadenorm`, and `python -m cascadenorm`: Ctrl-C ends in one line from the first import on."""

import gc
import os
import signal
from typing import NoReturn

OBJECTS_BETWEEN_COLLECTIONS = 1_000_000
"""Objects after which Python searches for cycles of garbage; loading all libraries creates fewer, and no garbage."""
INTERRUPTED = "cascadenorm: interrupted; no file was left half written\n"


def main() -> NoReturn:
    """Run the command line and exit."""
    gc.set_threshold(OBJECTS_BETWEEN_COLLECTIONS)
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
