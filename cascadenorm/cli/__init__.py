"""The command line: commands, their options, tables and JSON, and the demonstration."""

import sys
from collections.abc import Sequence
from importlib import import_module
from typing import NoReturn

__all__ = ["main", "run"]


def main(arguments: Sequence[str] | None = None) -> NoReturn:
    """Run the command line and exit; what it needs is loaded here, so that Ctrl-C then ends in a line as well."""
    vars(sys.modules["__main__"]).pop("__file__", None)  # worker processes need not run the script that started this
    try:
        program = import_module("cascadenorm.cli.program")
    except KeyboardInterrupt:
        print("cascadenorm: interrupted; no file was left half written", file=sys.stderr)
        sys.exit(130)
    sys.exit(program.main(arguments))


def run(arguments: Sequence[str]) -> int:
    """Run the command line and return its exit code."""
    return int(import_module("cascadenorm.cli.program").run(arguments))
