"""Store meshes and measures of an evaluation, so that it can resume."""

import hashlib
import json
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple

from cascadenorm.api.api import weights_digest
from cascadenorm.io.atomic import make_folder, write_atomically
from cascadenorm.io.digests import file_digest, source_digest
from cascadenorm.io.interop import save_mesh
from cascadenorm.io.pairs import FilePair
from cascadenorm.mesh import Mesh
from cascadenorm.registry import find
from cascadenorm.version import __version__


def folder_name(pair: str) -> str:
    """Return the name of the folder for a pair, whose own name may contain slashes."""
    return pair.replace("/", "_").replace("\\", "_")


class Records(NamedTuple):
    """A folder with one subfolder per pair, which contains `<method>.ply` and `<method>.json`."""

    folder: Path

    def mesh_file(self, pair: str, name: str) -> Path:
        return self.folder / folder_name(pair) / f"{name}.ply"

    def key(
        self, pair: FilePair, name: str, settings: Mapping[str, Any] | None, command: Sequence[str], file: Path | None
    ) -> str:
        """Return a digest of everything a result depends on, except the program that a command runs.

        For methods from outside this package, the digest includes their source.
        """
        parts = [
            __version__,
            file_digest(pair.noisy),
            file_digest(pair.clean),
            {key: str(value) for key, value in (settings or {}).items() if key != "threads"},
            None if settings is None else weights_digest(name, settings),
            "" if settings is None else source_digest(find(name).function),
            list(command),
            file and file_digest(file),
        ]
        return hashlib.sha256(json.dumps(parts, sort_keys=True).encode()).hexdigest()

    def load(self, pair: FilePair, name: str, key: str) -> dict[str, Any] | None:
        """Return the stored row of a result if its key matches, else None."""
        path = self.mesh_file(pair.name, name)
        try:
            kept = json.loads(path.with_suffix(".json").read_text(encoding="utf-8"))
        except (OSError, ValueError):
            return None
        matches = isinstance(kept, dict) and kept.get("key") == key and path.exists()
        return dict(kept["row"]) if matches else None

    def save(self, pair: FilePair, name: str, key: str, mesh: Mesh, row: Mapping[str, Any]) -> None:
        """Store a mesh and then its row, whose presence marks both as complete."""
        path = self.mesh_file(pair.name, name)
        make_folder(path.parent)
        record = path.with_suffix(".json")
        record.unlink(missing_ok=True)
        save_mesh(path, mesh, force=True)
        text = json.dumps({"key": key, "row": row}, indent=1)
        write_atomically(record, [text.encode()], force=True)
