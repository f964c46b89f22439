"""The meshes of a report."""

import hashlib
from collections.abc import Sequence
from pathlib import Path
from typing import Any, NamedTuple

from cascadenorm import io
from cascadenorm.io.interop import as_file, is_stored, mesh_of_file, source_name
from cascadenorm.mesh import Mesh, scaled_alike

LABELS = {"before": "Before", "after": "After", "truth": "Truth", "mesh": "Mesh"}  # labels of the meshes of a report


class Given(NamedTuple):
    """A mesh with its name in a report."""

    key: str  # one of LABELS, or the name of a method
    name: str  # name of the file or of the kind of mesh
    file: io.MeshFile  # the file as it was read, possibly with moved vertices
    from_file: bool = True  # whether `file` holds the bytes of a file, which have a checksum

    @property
    def mesh(self) -> Mesh:
        """The triangle mesh; error messages begin with the name."""
        return mesh_of_file(self.file, self.name)

    @property
    def label(self) -> str:
        return LABELS.get(self.key, self.key)

    def checksum(self) -> tuple[int, str] | None:
        """Return the size of the file in bytes and its SHA-256; None for a mesh without a file."""
        if not self.from_file:
            return None
        if Path(self.name).is_file():
            data = Path(self.name).read_bytes()
        elif self.file.has_moved:  # written to a stream
            return None
        else:
            data = self.file.data
        return len(data), hashlib.sha256(data).hexdigest()


def scaled_meshes(shown: Sequence[Given]) -> dict[str, Mesh]:
    """Return the meshes by key, scaled alike to about unit size."""
    return dict(zip((one.key for one in shown), scaled_alike(*(one.mesh for one in shown)), strict=True))


def checked_truth(truth: Any) -> Given:
    """Return the true mesh of a report; raise the errors of reading and checking it before any other work."""
    one = given("truth", truth)
    one.mesh  # noqa: B018 - checked when it is first asked for
    return one


def given(key: str, source: Any) -> Given:
    """Convert a mesh of any kind that `denoise` accepts; a Given is returned as it is."""
    if isinstance(source, Given):
        return source
    return Given(key, source_name(source), as_file(source), from_file=is_stored(source))
