"""The command line: commands, their tables and JSON, and the demonstration."""

from cascadenorm.cli.commands import app, main, run

__all__ = ["app", "main", "run"]
