"""Mesh files whose holes are filled."""

from dataclasses import dataclass
from pathlib import Path

from cascadenorm import io
from cascadenorm.geometry.holes.filling import Outer, filled
from cascadenorm.geometry.laplacians import Order
from cascadenorm.io.atomic import check_output
from cascadenorm.io.files import check_extension, extensible
from cascadenorm.io.hole_patches import HolePatches
from cascadenorm.io.interop import mesh_of_file, source_name


@dataclass(frozen=True, kw_only=True)
class Filling:
    """What was added to a file.

    Parameters
    ----------
    faces, added
        Triangles that were there, and further ones.
    closed
        Holes.
    outer, long
        Edges of each boundary that was kept: of an open component, and of more edges than are closed.
    left_out
        What the source holds and the output does not, in words.
    """

    faces: int
    added: int
    closed: int
    outer: tuple[int, ...]
    long: tuple[int, ...]
    left_out: tuple[str, ...]


def fill_holes_file(
    source: Path,
    output: Path,
    *,
    order: Order = 2,
    max_edges: int | None = None,
    outer: Outer = "keep",
    force: bool = False,
) -> Filling:
    """Fill the holes of a mesh file, as `fill_holes` does; what is there stays, and the patches get values like it.

    PLY, OBJ and glTF keep all that they hold; in other formats what is kept is what another format could take over.

    Raises
    ------
    ReadError, MeshError, ParameterError, OutputError
        Nothing is written then.
    """
    check_output(output, force=force)
    check_extension(source, output)
    read = io.read(source)
    format = io.output_format(output, read.format)
    mesh_of_file(read, source_name(source))
    file, lost = extensible(read)
    mesh, holes = filled(file.mesh, order=order, max_edges=max_edges, outer=outer)
    added = len(mesh.faces) - len(file.mesh.faces)
    if added:
        patches = HolePatches(file, mesh)
        left_out = lost + io.write(file.with_patches(patches), output, format=format, force=force) + patches.left_out
    else:
        left_out = io.write(read, output, format=format, force=force)
    return Filling(
        faces=len(file.mesh.faces),
        added=added,
        closed=len(holes.closed),
        outer=tuple(map(len, holes.outer)),
        long=tuple(map(len, holes.long)),
        left_out=tuple(dict.fromkeys(left_out)),
    )
