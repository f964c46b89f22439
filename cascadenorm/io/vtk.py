"""Formats that meshio reads: VTK grids (legacy and VTU), Gmsh and Abaqus. Data of points and cells are kept."""

import copy
import math
import re
import sys
import tempfile
from collections.abc import Iterable, Mapping, Sequence
from contextlib import redirect_stderr
from functools import cache
from io import StringIO
from pathlib import Path
from typing import Any, ClassVar

import numpy as np
from numpy.typing import NDArray

from cascadenorm.errors import OutputError, ReadError, counted, reason
from cascadenorm.io.base import MeshFile, Piece
from cascadenorm.io.content import Content, single_numbers
from cascadenorm.io.libraries import explained
from cascadenorm.io.limits import check_expansion, limited_expansion
from cascadenorm.io.polydata import with_title
from cascadenorm.mesh.normals import NORMALS, Normals, RenewNormals
from cascadenorm.mesh.polygons import Polygons

FACE_CELLS = ("triangle", "quad", "polygon")
BESIDE = ("line", "vertex", "polyline", "poly_vertex")
SKIPPED = re.compile(r"cannot handle|skipping|couldn't be processed", re.I)
"""Warnings of meshio about content that it does not read."""
GRID = re.compile(rb"^[ \t]*DIMENSIONS((?:[ \t]+\d+)+)", re.M | re.I)
CELL_VALUES = re.compile(rb"^[ \t]*CELL_DATA[ \t]", re.M | re.I)
XML_TEXTS = re.compile(rb"<Array\b[^>]*\btype\s*=\s*[\"']String")
HAS_TEXTS = "it holds an array of texts, which meshio does not know: remove it, or save the surface as vtp"
LZ4 = re.compile(rb"compressor\s*=\s*[\"']vtkLZ4DataCompressor")

NORMALS_LINE = re.compile(rb"^NORMALS(?=[ \t]+\S+[ \t]+\w+[ \t]*\r?$)", re.M | re.I)
TEXTURE_LINE = re.compile(rb"^TEXTURE_COORDINATES[ \t]+(\S+)[ \t]+(\d+)[ \t]+(\w+)[ \t]*\r?$", re.M | re.I)
IDS_LINE = re.compile(rb"^(?:GLOBAL|PEDIGREE)_IDS[ \t]+(\S+)[ \t]+(\w+)[ \t]*\r?$", re.M | re.I)
COLORS_LINE = re.compile(rb"^COLOR_SCALARS[ \t]+(\S+)[ \t]+(\d+)[ \t]*\r?$", re.M | re.I)
TYPED_LINE = re.compile(
    rb"^((?:(?:SCALARS|VECTORS|TENSORS)[ \t]+\S+|POINTS[ \t]+\d+|\S+[ \t]+\d+[ \t]+\d+)[ \t]+)([a-z]\w*)"
    rb"((?:[ \t]+\d)?[ \t]*\r?)$",
    re.M | re.I,
)
"""Lines of legacy VTK files with the type of an array: before it, the type, and after it."""
SIZES = {
    b"signed_char": b"int8",
    b"char": b"int8",
    b"unsigned_char": b"uint8",
    b"short": b"int16",
    b"unsigned_short": b"uint16",
    b"vtkidtype": b"int32",  # in files, whatever it is in memory
    b"int": b"int32",
    b"unsigned_int": b"uint32",
    b"long": b"int64",
    b"unsigned_long": b"uint64",
}
"""Integers by the names of their types in legacy VTK files."""
TO_MESHIO = {name: b"vtktype" + kind for name, kind in SIZES.items()}
"""Names of types that meshio uses in version 5.1, by those of VTK."""
FROM_MESHIO = {b"vtktype" + kind: name for name, kind in SIZES.items()}
"""Names of types that meshio uses before version 5.1, by the others."""


class MeshioFile(MeshFile):
    """A grid whose cells are polygons. Positions are float32 or float64."""

    module: ClassVar[str]  # module of meshio
    needs = ("meshio", "meshio", "formats")
    made_with: ClassVar[dict[str, Any]] = {}  # options for writing content of other formats
    holds_polygons: ClassVar[bool] = True  # whether faces may have more than four corners
    holds_values: ClassVar[bool] = True  # whether vertices and faces may have values
    moving_loses: tuple[str, ...] = ("what meshio does not keep (layout, types of data)",)

    def _parse(self) -> tuple[NDArray[Any], Polygons]:
        from meshio.vtu import _vtu

        self._skipped: list[str] = []
        problem = f"meshio cannot read this as {self.format}"
        with explained(problem, said=_said), limited_expansion(len(self.data), _vtu):
            self._grid = self._load()
        points = np.asarray(self._grid.points)
        if points.ndim != 2 or points.shape[1] != 3:
            raise ReadError(f"the points of this {self.format} file have {points.shape[-1]} coordinates, not 3")
        other = sorted({block.type for block in self._grid.cells} - {*FACE_CELLS, *BESIDE})
        if other:
            raise ReadError(f"the file has cells of type {', '.join(other)}: extract the surface first")
        blocks = [np.asarray(block.data, np.int64) for block in self._grid.cells if block.type in FACE_CELLS]
        kind = np.float32 if points.dtype == np.float32 else np.float64
        polygons = [Polygons.from_counts(np.full(len(block), block.shape[1]), block.ravel()) for block in blocks]
        return points.astype(kind), Polygons.joined(polygons)

    def _load(self) -> Any:
        import meshio

        if grid := GRID.search(self.data[:10_000]):  # a grid whose points and cells are not stored in the file
            points = math.prod(map(int, grid[1].split()))
            check_expansion(100 * points, len(self.data), "the points of this grid")

        with tempfile.TemporaryDirectory() as folder, redirect_stderr(StringIO()) as said:
            path = Path(folder) / f"grid.{self.format}"
            path.write_bytes(self._understood())
            grid = getattr(meshio, self.module).read(path)
        warnings = [text.strip(" .") for text in " ".join(said.getvalue().split()).split("Warning: ")[1:]]
        if self.format == "vtk" and not grid.cell_data and CELL_VALUES.search(self.data):
            warnings.append("Skipping the data of cells, some of which are polygons")
        for warning in dict.fromkeys(warnings):
            if "not closed" in warning:  # meshio does not read the rest of a Gmsh file
                raise ReadError(f"meshio cannot read this as {self.format}: {warning}")
            if SKIPPED.search(warning):
                self._skipped.append(f"what meshio skipped ({warning})")
        self.moving_loses = (*self.moving_loses, *self._skipped)
        return grid

    def _understood(self) -> bytes:
        """Return the file with the same content in words that meshio knows."""
        return self.data

    def _moved_pieces(self) -> Iterable[Piece]:
        grid = copy.deepcopy(self._grid)
        triangles, owners = self.triangles, self.triangle_polygons
        move_grid(grid, self.positions, triangles, owners, lambda *normals: self._renewed(Normals(*normals))[0])
        return [_written(grid, self.module, self.format, self._options())]

    def _options(self) -> dict[str, Any]:
        """Return the options that write the file as it was read."""
        return {}

    def _read_content(self) -> Content:
        faces = [i for i, block in enumerate(self._grid.cells) if block.type in FACE_CELLS]
        values, left_out = single_numbers(((name, [value]) for name, value in self._grid.point_data.items()), "point")
        cells = ((name, [blocks[i] for i in faces]) for name, blocks in self._grid.cell_data.items())
        face_values, others = single_numbers(cells, "cell")
        others += [f"field data '{name}'" for name in self._grid.field_data]
        left_out += self._skipped + others + (["points and lines"] if len(faces) < len(self._grid.cells) else [])
        return Content(self.positions, self.polygons, values, face_values, tuple(left_out))

    @classmethod
    def encode(cls, content: Content) -> tuple[Iterable[Piece], list[str]]:
        """Write content with the values of vertices and faces. Faces are grouped by their number of corners."""
        import meshio

        counts = content.polygons.counts
        others = int((~np.isin(counts, (3, 4))).sum())
        if others and not cls.holds_polygons:
            raise OutputError(
                f"the format '{cls.format}' holds triangles and quads only, and "
                f"{counted(others, 'face has', 'faces have')} another number of corners",
                hint="write ply, obj, off, vtk or vtu, or triangulate the mesh first",
            )
        blocks, names = list(content.polygons.by_count()), {3: "triangle", 4: "quad"}
        grid = meshio.Mesh(
            content.positions,
            [(names.get(corners.shape[1], "polygon"), corners) for _, corners in blocks],
            point_data=dict(content.vertex_values),
            cell_data={name: [values[rows] for rows, _ in blocks] for name, values in content.face_values.items()},
        )
        lost = [] if cls.holds_values else content.lost_values()
        lost += ["the order of the faces"] if (np.diff(counts) < 0).any() else []
        return [_written(grid, cls.module, cls.format, cls.made_with)], lost


class VtkFile(MeshioFile):
    """A legacy VTK file with an unstructured grid. It is written in version 4.2.

    VTK and meshio read each other's integers only in this version.
    """

    format = module = "vtk"
    made_with: ClassVar[dict[str, Any]] = {"fmt_version": "4.2"}

    def _options(self) -> dict[str, Any]:
        """Return the version to write and the encoding of the file that was read."""
        return {**self.made_with, "binary": b"BINARY" in b"".join(self.data[:1000].splitlines()[2:3]).upper()}

    def _load(self) -> Any:
        grid = super()._load()
        grid.point_data = {name: _writable(values) for name, values in grid.point_data.items()}
        grid.cell_data = {name: list(map(_writable, blocks)) for name, blocks in grid.cell_data.items()}
        return grid

    def _moved_pieces(self) -> Iterable[Piece]:
        return [with_title(b"".join(super()._moved_pieces()), self.data)]

    def _understood(self) -> bytes:
        """Return the file with the names of types, and of data like vectors and scalars, that meshio knows.

        In version 5.1, it knows few types and takes int for 64 bits. It needs a line end after the last binary array,
        which Gmsh does not write.
        """
        data, color = self.data + b"\n", b"unsigned_char" if self._options()["binary"] else b"float"
        data = NORMALS_LINE.sub(b"VECTORS", data)
        data = TEXTURE_LINE.sub(rb"SCALARS \1 \3 \2\nLOOKUP_TABLE default", data)
        data = IDS_LINE.sub(rb"SCALARS \1 \2 1\nLOOKUP_TABLE default", data)
        data = COLORS_LINE.sub(rb"SCALARS \1 " + color + rb" \2\nLOOKUP_TABLE default", data)
        data = _with_types(data, TO_MESHIO)
        return data if data[:100].splitlines()[0].rstrip().endswith(b"5.1") else _with_types(data, FROM_MESHIO)


def _writable(values: NDArray[Any]) -> NDArray[Any]:
    """Return an array as meshio writes it correctly: tensors as rows, and truth values as bytes."""
    rows = values.reshape(len(values), -1) if values.ndim > 2 else values
    return rows.astype(np.uint8) if rows.dtype == bool else rows


class VtuFile(MeshioFile):
    """A VTU file."""

    format = module = "vtu"

    def _load(self) -> Any:
        if LZ4.search(self.data[:1000]):
            raise ReadError("this vtu file is compressed with LZ4, which meshio does not read: write it with ZLib")
        if XML_TEXTS.search(self.data):
            raise ReadError(f"meshio cannot read this as vtu: {HAS_TEXTS}")
        return super()._load()


class GmshFile(MeshioFile):
    """A Gmsh mesh. It is written in version 2.2, since meshio requires entities for later versions."""

    format, module = "msh", "gmsh"
    holds_polygons = False
    made_with: ClassVar[dict[str, Any]] = {"fmt_version": "2.2"}
    moving_loses = ("what meshio does not keep of a Gmsh file (entities, versions after 2.2)",)

    def _load(self) -> Any:
        _mend_gmsh_reader()
        grid = super()._load()
        grid.point_data.pop("gmsh:dim_tags", None)
        grid.cell_sets.pop("gmsh:bounding_entities", None)
        return grid

    def _options(self) -> dict[str, Any]:
        """Return the version to write and the encoding of the file that was read."""
        found = re.search(rb"\$MeshFormat\s+\d[\d.]*\s+(\d)", self.data)
        return {**self.made_with, "binary": found is None or found[1] == b"1"}


ELEMENTS = re.compile(rb"^(\*ELEMENT\b[^\r\n]*?\bTYPE[ \t]*=[ \t]*)(\w+)", re.M | re.I)
"""A line of an Abaqus file that begins elements, up to their type."""
GENERATED = re.compile(rb"^\*\w+[^\r\n]*\bGENERATE\b[^\r\n]*[\r\n][\s,]*(\d+)[\s,]+(\d+)[\s,]+(\d+)", re.M | re.I)
"""A set of an Abaqus file whose members are given by the first one, the last one and the step between them."""
MEMBER = 40  # bytes that meshio needs for a member of a set


class AbaqusFile(MeshioFile):
    """Nodes and elements of an Abaqus input file. Steps and materials are lost when vertices move."""

    format, module = "inp", "abaqus"
    holds_polygons = holds_values = False
    made_with: ClassVar[dict[str, Any]] = {"translate_cell_names": False}
    moving_loses = (
        "what meshio does not keep of an Abaqus file (numbers of nodes and elements, and all but nodes, elements and "
        "sets)",
    )

    def _load(self) -> Any:
        if re.search(rb"^\*include\b", self.data, re.M | re.I):
            raise ReadError("this Abaqus file includes other files, which are not read: put their content into it")
        ranges = ((float(first), float(last), float(step)) for first, last, step in GENERATED.findall(self.data))
        members = sum(max(last - first, 0) / max(step, 1) + 1 for first, last, step in ranges)
        check_expansion(MEMBER * members, len(self.data), "the sets of this file")
        return super()._load()

    def _moved_pieces(self) -> Iterable[Piece]:
        made, types = b"".join(super()._moved_pieces()), [found[2] for found in ELEMENTS.finditer(self.data)]
        if len(types) != len(ELEMENTS.findall(made)):
            return [made]
        names = iter(types)  # meshio would write triangles as R3D3, and quads as CAX4P
        return [ELEMENTS.sub(lambda found: found[1] + next(names), made)]

    @classmethod
    def encode(cls, content: Content) -> tuple[Iterable[Piece], list[str]]:
        """Write content as shell elements."""
        made, lost = super().encode(content)
        return [b"".join(made).replace(b"TYPE=triangle", b"TYPE=S3").replace(b"TYPE=quad", b"TYPE=S4")], lost


@cache
def _mend_gmsh_reader() -> None:
    """Let meshio read data of several kinds of elements, and entities of which only some belong to a physical group."""
    from meshio.gmsh import _gmsh22, _gmsh40, _gmsh41

    for module in (_gmsh22, _gmsh40, _gmsh41):
        module.cell_data_from_raw = _data_by_block
    read_entities = _gmsh41._read_entities

    def with_all_groups(*given: Any) -> tuple[Any, Any]:
        groups, boundaries = read_entities(*given)
        if any(group for of_entities in groups for group in of_entities.values()):
            groups = tuple({tag: group or [0] for tag, group in of_entities.items()} for of_entities in groups)
        return groups, boundaries

    _gmsh41._read_entities = with_all_groups


def _data_by_block(cells: Sequence[Any], data: Mapping[str, NDArray[Any]]) -> dict[str, list[NDArray[Any]]]:
    """Split data of elements into those of each block; meshio counts two elements in every block of a Gmsh file.

    Data that only some elements have are skipped with a warning like those of meshio.
    """
    sizes = [len(block[1]) if isinstance(block, tuple) else len(block.data) for block in cells]
    kept = {name: values for name, values in data.items() if len(values) == sum(sizes)}
    for name in data:
        if name not in kept:
            print(f"Warning: skipping '{name}', which only some elements have", file=sys.stderr)
    return {name: np.split(values, np.cumsum(sizes)[:-1]) for name, values in kept.items()}


def _said(error: Exception) -> str:
    """Describe an error of meshio."""
    if re.search(r"'(string|unicode_string)'", str(error), re.I):  # the type of an array, such as field data of PyVista
        return HAS_TEXTS
    return reason(error)


def _written(grid: Any, module: str, format: str, options: dict[str, Any]) -> bytes:
    import meshio

    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / f"grid.{format}"
        plain = np.printoptions(legacy="1.21")  # otherwise meshio writes "np.float64(1.5)" for 1.5 into a Gmsh text
        said = explained(f"meshio cannot write {format}", OutputError, hint="choose ply")
        with said, plain, redirect_stderr(StringIO()):
            getattr(meshio, module).write(path, grid, **options)
        return path.read_bytes()


def _with_types(data: bytes, names: dict[bytes, bytes]) -> bytes:
    """Return a legacy VTK file with other names of types."""
    return TYPED_LINE.sub(lambda line: line[1] + names.get(line[2].lower(), line[2]) + line[3], data)


def move_grid(
    mesh: Any, positions: NDArray[Any], triangles: NDArray[Any], owners: NDArray[Any], renew: RenewNormals
) -> None:
    """Replace the points of a meshio mesh, and recompute its normals at the corners of its triangles.

    `renew` converts normals and their index at each corner, the point in `triangles` or the face in `owners`.
    """
    mesh.points = positions
    faces = [i for i, block in enumerate(mesh.cells) if block.type in FACE_CELLS]
    for name in NORMALS:
        values = mesh.point_data.get(name)
        if values is not None and np.shape(values) == np.shape(mesh.points):
            mesh.point_data[name] = renew(np.asarray(values), triangles).astype(np.asarray(values).dtype)
        blocks = mesh.cell_data.get(name)
        if blocks is not None and faces and all(np.ndim(blocks[i]) == 2 and np.shape(blocks[i])[1] == 3 for i in faces):
            stored = np.concatenate([np.asarray(blocks[i]) for i in faces])
            normals = renew(stored, np.repeat(owners[:, None], 3, axis=1))
            ends = np.cumsum([len(blocks[i]) for i in faces])[:-1]
            for i, new in zip(faces, np.split(normals, ends), strict=True):
                blocks[i] = new.astype(np.asarray(blocks[i]).dtype)
