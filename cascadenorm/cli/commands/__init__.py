"""The commands: each parses, calls one public function, prints.

Results go to stdout, messages and progress to stderr. What a command uses is imported in it, so that the command line
starts at once.
"""

from cascadenorm.cli.app import app
from cascadenorm.cli.commands import browsing, denoising, drawing, measuring, training  # noqa: F401 - they add themselves

__all__ = ["app"]
