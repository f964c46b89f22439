"""The command line: commands, their options, tables and JSON, and the demonstration."""

from cascadenorm.cli.commands import app
from cascadenorm.cli.program import main, run

__all__ = ["app", "main", "run"]
