"""Fill the holes of mesh files."""

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
    """Summary of the holes filled in a file."""

    faces: int  # number of triangles before filling
    added: int  # number of triangles that were added
    closed: int  # number of holes that were closed
    outer: tuple[int, ...]  # edge counts of the boundaries of open components, which were left open
    long: tuple[int, ...]  # edge counts of the boundaries longer than `max_edges`, which were left open
    left_out: tuple[str, ...]  # content of the source that the output lacks, in words


def fill_holes_file(
    source: Path,
    output: Path,
    *,
    order: Order = 2,
    max_edges: int | None = None,
    outer: Outer = "keep",
    force: bool = False,
) -> Filling:
    """Fill the holes of a mesh file as `fill_holes` does; existing content stays, and patches get matching values.

    PLY, OBJ and glTF files keep all their content. Files of other formats keep what a conversion to another format
    keeps. If an error is raised, nothing is written.
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
        patched = file.with_patches(patches)
        patched.mark = file.mark
        left_out = lost + io.write(patched, output, format=format, force=force) + patches.left_out
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
