"""VTK PolyData in XML (VTP) and legacy files, through VTK. The data of points and cells are kept."""

import re
import tempfile
from collections.abc import Iterable
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from cascadenorm.errors import OutputError, ReadError
from cascadenorm.io.base import MeshFile, Piece
from cascadenorm.io.content import Content, single_numbers
from cascadenorm.io.limits import check_expansion
from cascadenorm.io.text.number_format import replace_words
from cascadenorm.io.text.text import Text
from cascadenorm.io.vtk_sizes import check_legacy_counts, check_xml_arrays
from cascadenorm.mesh.normals import NORMALS, Normals, RenewNormals
from cascadenorm.mesh.polygons import Polygons

COUNTS = re.compile(rb'NumberOf(?:Points|Verts|Lines|Strips|Polys)\s*=\s*["\'](\d{1,18})')
LEGACY = re.compile(rb"#\s*vtk DataFile[^\n]*\n[^\n]*\n\s*(ASCII|BINARY)\s+DATASET\s+POLYDATA", re.I)


class PolyDataFile(MeshFile):
    """A VTP file. Positions are float32 or float64. Vertex and line cells are kept."""

    format = "vtp"
    needs = ("vtkmodules", "pyvista", "pyvista")
    moving_loses = ("what VTK does not keep (comments, layout)",)

    def _parse(self) -> tuple[NDArray[Any], Polygons]:
        announced = sum(map(int, COUNTS.findall(self.data[:100_000])))
        check_expansion(24 * announced, len(self.data), "the points and cells of this file")
        self._surface = self._load()
        polygons, points = self._surface.GetPolys(), self._surface.GetPoints()
        if self._surface.GetNumberOfStrips():
            raise ReadError("the file has triangle strips: apply vtkTriangleFilter to it, in ParaView Triangulate")
        positions = vtk_array(points.GetData()) if points is not None else np.zeros((0, 3))
        indptr = vtk_array(polygons.GetOffsetsArray()).astype(np.int64)
        corners = vtk_array(polygons.GetConnectivityArray()).astype(np.int64)
        indptr = indptr if len(indptr) else np.zeros(1, np.int64)
        if indptr[0] != 0 or (np.diff(indptr) < 0).any() or indptr[-1] != len(corners):
            raise ReadError(f"the cells of this {self.format} file do not fit together: get a complete copy")
        kind = np.float32 if positions.dtype == np.float32 else np.float64
        return positions.astype(kind), Polygons(indptr, corners)

    def _load(self) -> Any:
        from vtkmodules.vtkIOXML import vtkXMLPolyDataReader

        check_xml_arrays(self.data)
        return self._read_by(vtkXMLPolyDataReader(), self.data)

    def _read_by(self, reader: Any, data: bytes) -> Any:
        with tempfile.TemporaryDirectory() as folder:
            path = Path(folder) / f"surface.{self.format}"
            path.write_bytes(data)
            reader.SetFileName(str(path))
            said = _run(reader.Update)
        if said or reader.GetErrorCode():
            raise ReadError(f"VTK cannot read this as {self.format}: {said or 'the file is damaged'}")
        return reader.GetOutput()

    def _moved_pieces(self) -> Iterable[Piece]:
        surface = self._surface.NewInstance()
        surface.DeepCopy(self._surface)
        triangles, owners = self.triangles, self.triangle_polygons
        move_polydata(surface, self.positions, triangles, owners, lambda *normals: self._renewed(Normals(*normals))[0])
        return [self._written(surface)]

    def _written(self, surface: Any) -> bytes:
        from vtkmodules.vtkIOXML import vtkXMLPolyDataWriter

        return _written_by(vtkXMLPolyDataWriter(), surface, self.format)

    def _read_content(self) -> Content:
        surface = self._surface
        first = surface.GetNumberOfVerts() + surface.GetNumberOfLines()
        of_points, of_cells = _named(surface.GetPointData()), _named(surface.GetCellData())
        points = ((name, [vtk_array(array)]) for name, array in of_points if name and array is not None)
        cells = ((name, [vtk_array(array)[first:]]) for name, array in of_cells if name and array is not None)
        values, left_out = single_numbers(points, "point")
        face_values, others = single_numbers(cells, "cell")
        others += [f"point data '{name}'" for name, array in of_points if array is None]
        others += [f"cell data '{name}'" for name, array in of_cells if array is None]
        others += [f"field data '{name}'" for name, _ in _named(surface.GetFieldData())]
        left_out += others + (["points and lines"] if first else [])
        return Content(self.positions, self.polygons, values, face_values, tuple(left_out))

    @classmethod
    def encode(cls, content: Content) -> tuple[Iterable[Piece], list[str]]:
        """Write content with all values of vertices and faces."""
        from vtkmodules.util.numpy_support import numpy_to_vtk, numpy_to_vtkIdTypeArray
        from vtkmodules.vtkCommonCore import vtkPoints
        from vtkmodules.vtkCommonDataModel import vtkCellArray, vtkPolyData
        from vtkmodules.vtkIOXML import vtkXMLPolyDataWriter

        points, cells, surface = vtkPoints(), vtkCellArray(), vtkPolyData()
        points.SetData(numpy_to_vtk(np.ascontiguousarray(content.positions), deep=True))
        indptr, corners = (np.ascontiguousarray(a, np.int64) for a in content.polygons)
        cells.SetData(numpy_to_vtkIdTypeArray(indptr, deep=True), numpy_to_vtkIdTypeArray(corners, deep=True))
        surface.SetPoints(points)
        surface.SetPolys(cells)
        for data, values in (
            (surface.GetPointData(), content.vertex_values),
            (surface.GetCellData(), content.face_values),
        ):
            for name, value in values.items():
                array = numpy_to_vtk(np.ascontiguousarray(value), deep=True)
                array.SetName(name)
                data.AddArray(array)
        return [_written_by(vtkXMLPolyDataWriter(), surface, cls.format)], []


class LegacyPolyDataFile(PolyDataFile):
    """A legacy VTK file with PolyData. Files with grids are read by `VtkFile`."""

    format = "vtk"

    def _load(self) -> Any:
        from vtkmodules.vtkIOLegacy import vtkPolyDataReader

        check_legacy_counts(self.data)
        reader = vtkPolyDataReader()
        for kind in ("Scalars", "Vectors", "Normals", "Tensors", "TCoords", "Fields"):
            getattr(reader, f"ReadAll{kind}On")()
        # In a text file that is cut within a number, VTK would leave all further numbers uninitialised without an error
        return self._read_by(reader, self.data if self._is_binary() else self.data + b"\n")

    def _written(self, surface: Any) -> bytes:
        from vtkmodules.vtkIOLegacy import vtkPolyDataWriter

        writer = vtkPolyDataWriter()
        if self._is_binary():
            writer.SetFileTypeToBinary()
        made = with_title(_written_by(writer, surface, self.format), self.data)
        points = re.search(rb"\nPOINTS \d+ \w+\n", made)
        if self._is_binary() or points is None:
            return made
        text = Text(made, start=points.end())  # VTK writes six digits, or eleven in double precision
        return b"".join(replace_words(text, (np.arange(self.positions.size), self.positions.ravel())))

    def _is_binary(self) -> bool:
        head = LEGACY.match(self.data)
        return head is not None and head[1].upper() == b"BINARY"


def with_title(made: bytes, source: bytes) -> bytes:
    """Return a legacy VTK file with the title of another one, which may name the coordinate system, as of 3D Slicer."""
    title = source[:1000].splitlines()[1]
    first, _, rest = made.split(b"\n", 2)
    return b"\n".join((first, title, rest))


def vtk_array(array: Any) -> NDArray[Any]:
    """Return a view of a VTK array."""
    from vtkmodules.util.numpy_support import vtk_to_numpy

    return np.asarray(vtk_to_numpy(array))


def move_polydata(
    surface: Any, positions: NDArray[Any], triangles: NDArray[Any], owners: NDArray[Any], renew: RenewNormals
) -> None:
    """Replace the points of a vtkPolyData, and recompute its normals at the corners of its triangles.

    `renew` converts normals and their index at each corner, the point in `triangles` or the polygon in `owners`.
    """
    from vtkmodules.util.numpy_support import numpy_to_vtk

    if len(positions):
        surface.GetPoints().SetData(numpy_to_vtk(np.ascontiguousarray(positions), deep=True))
    first = surface.GetNumberOfVerts() + surface.GetNumberOfLines()  # cells before the polygons
    polygons = np.repeat(owners[:, None], 3, axis=1)
    for data, begin, corners in ((surface.GetPointData(), 0, triangles), (surface.GetCellData(), first, polygons)):
        arrays = [data.GetNormals(), *map(data.GetArray, NORMALS)]
        for array in {array.GetName(): array for array in arrays if array is not None}.values():
            if array.GetNumberOfComponents() == 3 and array.GetDataTypeAsString() in ("float", "double"):
                values = vtk_array(array)
                values[begin:] = renew(values[begin:], corners)  # a view of the array
                array.Modified()


def _named(data: Any) -> list[tuple[str, Any]]:
    """Return the names of arrays of points, cells or the field, and the arrays; None for those of texts."""
    return [(data.GetArrayName(i), data.GetArray(i)) for i in range(data.GetNumberOfArrays())]


def _written_by(writer: Any, surface: Any, format: str) -> bytes:
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / f"surface.{format}"
        writer.SetFileName(str(path))
        writer.SetInputData(surface)
        said = _run(writer.Write)
        if said or not path.exists():
            raise OutputError(f"VTK cannot write {format}: {said or 'no reason was given'}: choose ply")
        return path.read_bytes()


def _run(work: Any) -> str:
    """Call a function of VTK. Returns the first error that it reports, or an empty string."""
    from vtkmodules.vtkCommonCore import vtkLogger, vtkOutputWindow, vtkStringOutputWindow

    window, before = vtkStringOutputWindow(), vtkOutputWindow.GetInstance()
    verbosity = vtkLogger.GetCurrentVerbosityCutoff()
    vtkOutputWindow.SetInstance(window)
    vtkLogger.SetStderrVerbosity(vtkLogger.VERBOSITY_OFF)  # it prints errors besides the window
    try:
        work()
    finally:
        vtkOutputWindow.SetInstance(before)
        vtkLogger.SetStderrVerbosity(verbosity)
    lines = [line.strip() for line in str(window.GetOutput()).splitlines()]
    errors = [i for i, line in enumerate(lines) if line.upper().startswith("ERROR")]
    if not errors:
        return ""
    said = next((line for line in lines[errors[0] + 1 :] if line), lines[errors[0]])
    return re.sub(r"!? for file: .*", "", said.rpartition("): ")[2])[:200]  # the name of a temporary file
