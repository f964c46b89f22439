"""The manifest of a batch, in JSON lines. The last line of a file counts: `started`, `done` or `failed`."""

import json
import sys
from pathlib import Path
from typing import Any

from cascadenorm.errors import OutputError
from cascadenorm.io.atomic import explained_writing, make_folder, write_all
from cascadenorm.io.json_text import json_text

if sys.platform != "win32":
    import fcntl

MANIFEST_NAME = "manifest.jsonl"
REQUIRED = {"status", "input_sha256", "output", "output_sha256", "copies", "settings", "error"}
"""Keys of a line that a later batch reads."""

Line = dict[str, Any]


class Manifest:
    """The manifest of a batch, open for new lines. `last` is the last valid line of each output, by its name."""

    def __init__(self, path: Path) -> None:
        self.path = path
        self.last: dict[str, Line] = {}
        make_folder(path.parent)
        with explained_writing(self.path):
            self._file = self.path.open("ab+", buffering=0)
        try:
            self._lock()
            with explained_writing(self.path):
                self._file.seek(0)
                data = self._file.read()
                self._read(data)
                if data and not data.endswith(b"\n"):
                    self._file.write(b"\n")
        except BaseException:
            self.close()
            raise

    def add(self, line: Line) -> None:
        """Append a line, in a single write unless the disk is nearly full. Raises OutputError."""
        with explained_writing(self.path):
            write_all(self._file, json_text(line).encode() + b"\n")
        self.last[line["output"]] = line

    def close(self) -> None:
        """Close the file and release its lock, so that other batches can write to the folder."""
        self._file.close()

    def _read(self, data: bytes) -> None:
        for text in data.splitlines():
            line = _parsed(text)
            if line is not None:
                self.last[line["output"]] = line
        if data and not self.last and not data.startswith(b'{"'):  # a first line that was cut begins like this
            raise OutputError(f"{self.path} is not the manifest of a batch", hint="name another file")

    def _lock(self) -> None:
        if sys.platform == "win32":
            return
        try:
            fcntl.flock(self._file, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            raise OutputError(
                f"another batch is writing to {self.path.parent}", hint="wait for it, or choose another folder"
            ) from None
        except OSError:  # the file system does not support locks
            return


def _parsed(text: bytes) -> Line | None:
    try:
        line = json.loads(text)
    except ValueError:
        return None
    valid = isinstance(line, dict) and line.keys() >= REQUIRED
    valid = valid and all(isinstance(line[key], str) for key in ("output", "status"))
    return line if valid else None
