"""The command line interface."""

import sys
from collections.abc import Sequence
from importlib import import_module
from typing import NoReturn

__all__ = ["main", "run"]


def main(arguments: Sequence[str] | None = None) -> NoReturn:
    """Run the command line and exit; lazy imports let Ctrl-C end the program with a message while they load."""
    vars(sys.modules["__main__"]).pop("__file__", None)  # keeps worker processes from running the main script
    try:
        program = import_module("cascadenorm.cli.program")
    except KeyboardInterrupt:
        print("cascadenorm: interrupted; no file was left half written", file=sys.stderr)
        sys.exit(130)
    sys.exit(program.main(arguments))


def run(arguments: Sequence[str]) -> int:
    """Run the command line and return its exit code."""
    return int(import_module("cascadenorm.cli.program").run(arguments))
