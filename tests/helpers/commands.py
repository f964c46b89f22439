"""Commands as the tests run them, and the meshes that they are given."""

import subprocess
import sys

from shapes import icosphere, noisy

from cascadenorm.cli import run

CLEAN = icosphere(2)
ROUGH = noisy(CLEAN, 0.2)
FAST = ["--method", "laplacian"]


def command(*arguments: str, stdin: bytes | None = None) -> subprocess.CompletedProcess:
    """Run the installed command in a process of its own."""
    code = "from cascadenorm.cli import main; main()"
    return subprocess.run([sys.executable, "-c", code, *arguments], input=stdin, capture_output=True)


def refused(capsys, *arguments: str) -> tuple[int, str]:
    """Exit code and message of a run that has to end in one line on stderr, and nothing else."""
    code = run(arguments)
    out, err = capsys.readouterr()
    assert out == "" and "Traceback" not in err
    assert err.startswith("cascadenorm: ") and err.count("\n") == 1
    return code, err
