"""The commands of the command line.

Each command parses its options, calls one public function and prints the result. Results go to stdout, and messages and
progress to stderr. Each command imports what it needs when it is called, so that the command line starts quickly.
"""

from cascadenorm.cli.options import app

# isort: split
from cascadenorm.cli.commands import denoising  # noqa: F401 - it adds itself, first in the help

# isort: split
from cascadenorm.cli.commands import drawing, measuring, training  # noqa: F401 - they add themselves

__all__ = ["app"]
