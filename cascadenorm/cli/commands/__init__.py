"""The commands: each parses, calls one public function, prints.

Results go to stdout, messages and progress to stderr. What a command uses is imported in it, so that the command line
starts at once.
"""

from cascadenorm.cli.app import app

# isort: split
from cascadenorm.cli.commands import denoising  # noqa: F401 - it adds itself, first in the help

# isort: split
from cascadenorm.cli.commands import browsing, drawing, measuring, training  # noqa: F401 - they add themselves

__all__ = ["app"]
