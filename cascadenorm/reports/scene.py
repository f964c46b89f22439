"""The scene of the viewer as a JSON object."""

from collections.abc import Collection, Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from cascadenorm.geometry.fields import Field, fields
from cascadenorm.io.content import CHANNELS, channels
from cascadenorm.mesh import Floats, Mesh, Vectors, scale_between, scaled_alike
from cascadenorm.render import Camera
from cascadenorm.reports.decimation import MOST_SHOWN_FACES, Display, decimated
from cascadenorm.reports.given import Given, scaled_meshes
from cascadenorm.reports.packing import VALUE_STEPS, in_steps, packed, packed_faces
from cascadenorm.reports.places import DefectPlace

FORMAT = 1
LEVELS, FINE_LEVELS = (1 << 16) - 1, (1 << 24) - 1
FEWEST_LEVELS = 30
"""Levels per mean edge length below which FINE_LEVELS are used, for example if a part is far from the rest."""
MOST_TEXT = 11_200_000
"""Largest number of characters of all arrays, which keeps a page with viewer and picture below 12 MB."""
FEWER_STEPS = 64  # steps over the colours of a quantity if the page would be too large
LITTLE = 0.02  # fraction of its size by which a result may extend beyond the box; the viewer still draws it


class _Frame(NamedTuple):
    """The box in which positions are quantised."""

    # lower, extent: (3,) lower corner and size for the scaled meshes
    lower: NDArray[np.float64]
    extent: NDArray[np.float64]
    levels: int  # number of levels along each side
    unit: float  # unit length of the scaled meshes in the unit of the files

    def codes(self, vertices: Vectors) -> NDArray[np.int32]:
        """Return (n, 3) quantised positions; 0 along a side without length."""
        place = np.divide(vertices - self.lower, self.extent, out=np.zeros_like(vertices), where=self.extent > 0)
        return np.asarray(np.rint(place * self.levels), np.int32)

    def holds(self, mesh: Mesh) -> bool:
        """Return whether a mesh lies in the box, or extends only slightly beyond it."""
        lower, upper = mesh.box
        beyond = np.maximum(self.lower - lower, upper - self.lower - self.extent)
        return bool((beyond <= LITTLE * self.extent).all())


class _Drawn(NamedTuple):
    """A displayed mesh: scaled, with its displayed faces and the codes of its vertices."""

    mesh: Mesh
    shown: Display
    codes: NDArray[np.int32]


def viewer_scene(
    shown: Sequence[Given],
    places: Sequence[DefectPlace],
    *,
    own: Field | None = None,
    meshes: Mapping[str, Mesh] | None = None,
) -> dict[str, Any]:
    """Pack meshes, the quantities on them, values given by the caller, and places of defects.

    `meshes` are those of `scaled_meshes`; None computes them.

    Positions are quantised to LEVELS or FINE_LEVELS along each direction of the bounding box of all meshes. A mesh with
    the faces of an earlier one is stored as displacements of its vertices. If the scene would have more than MOST_TEXT
    characters, values are quantised more coarsely; if that is not enough, the meshes are decimated.
    """
    meshes = scaled_meshes(shown) if meshes is None else meshes
    frame = _frame(meshes.values(), scale_between(shown[0].mesh, meshes[shown[0].key]))
    quantities = [*_fields(meshes, frame), *([own] if own else [])]
    most, fewer_steps = MOST_SHOWN_FACES, False
    while True:
        packed_meshes, drawn = _packed_meshes(shown, meshes, frame, most=most)
        packed_fields = [_packed_field(field, drawn, fewer_steps=fewer_steps) for field in quantities]
        size = _characters([packed_meshes, packed_fields])
        if size <= MOST_TEXT:
            break
        if not fewer_steps:
            fewer_steps = True
        else:
            most = int(0.97 * MOST_TEXT / size * max(len(one.shown.faces) for one in drawn.values()))
    return {
        **_about(frame, meshes[shown[-1].key]),
        "meshes": packed_meshes,
        "fields": packed_fields,
        "places": [place._asdict() for place in places],
    }


def _characters(packs: Any) -> int:
    """Count the characters of all packed arrays."""
    if isinstance(packs, Mapping):
        return sum(len(value) if key == "data" else _characters(value) for key, value in packs.items())
    return sum(map(_characters, packs)) if isinstance(packs, list) else 0


class Comparison:
    """Scenes of a mesh and of results with the same faces; shared data are computed once."""

    def __init__(self, before: Given) -> None:
        self._given, self._mesh = before, before.mesh
        (mesh,) = scaled_alike(self._mesh)
        self._frame = _frame([mesh], scale_between(self._mesh, mesh))
        packed_meshes, self._drawn = _packed_meshes([before], {before.key: mesh}, self._frame)
        self._known: dict[str, Mapping[str, Floats]] = {}
        self.first = {**_about(self._frame, mesh), "meshes": packed_meshes, "fields": [], "places": []}
        """The scene of the mesh without heat maps, which is available quickly."""

    def with_result(self, after: Given, vertices: NDArray[Any]) -> dict[str, Any]:
        """Return what extends the first scene to both meshes, or a whole scene if the result does not fit its box.

        The vertices of `after`, (n, 3), are in the order of the mesh before.
        """
        before, mesh = scaled_alike(self._mesh, self._mesh.moved(vertices))
        unit = scale_between(self._mesh, before)
        if unit != self._frame.unit or not self._frame.holds(mesh):
            return viewer_scene([self._given, after], [])
        alone = {self._given.key: self._drawn[self._given.key].mesh}
        self._known = self._known or {field.name: field.values for field in _fields(alone, self._frame)}
        meshes = {**alone, after.key: mesh}
        packed_meshes, drawn = _packed_meshes([after], meshes, self._frame, self._drawn)
        return {
            "format": FORMAT,
            "completes": True,
            "meshes": packed_meshes,
            "fields": [_packed_field(one, drawn) for one in _fields(meshes, self._frame, self._known)],
        }


def _frame(meshes: Collection[Mesh], unit: float) -> _Frame:
    lowers, uppers = zip(*(mesh.box for mesh in meshes), strict=True)
    lower = np.min(lowers, axis=0)
    extent = np.max(uppers, axis=0) - lower
    edge = min(mesh.mean_edge_length for mesh in meshes)
    levels = LEVELS if edge * LEVELS >= FEWEST_LEVELS * extent.max() else FINE_LEVELS
    return _Frame(lower, extent, levels, unit)


def _about(frame: _Frame, seen: Mesh) -> dict[str, Any]:
    """Return the frame and the initial camera."""
    camera = Camera.looking_at(seen)
    return {
        "format": FORMAT,
        "lower": (frame.lower * frame.unit).tolist(),
        "extent": (frame.extent * frame.unit).tolist(),
        "levels": frame.levels,
        "view": {
            "from": camera.axes[2].tolist(),
            "target": (camera.center * frame.unit).tolist(),
            "reach": [reach * frame.unit for reach in camera.reach],
        },
    }


def _packed_meshes(
    shown: Sequence[Given],
    meshes: Mapping[str, Mesh],
    frame: _Frame,
    known: Mapping[str, _Drawn] | None = None,
    *,
    most: int = MOST_SHOWN_FACES,
) -> tuple[list[dict[str, Any]], dict[str, _Drawn]]:
    """Pack meshes; return them, and all displayed meshes including those in `known`."""
    packs, drawn = [], dict(known or {})
    for given in shown:
        mesh = meshes[given.key]
        like = next((key for key, one in drawn.items() if np.array_equal(one.mesh.faces, mesh.faces)), None)
        faces = drawn[like].shown if like else decimated(mesh, most=most)
        codes = frame.codes(mesh.vertices)[faces.kept_vertices]
        drawn[given.key] = _Drawn(mesh, faces, codes)
        packs.append(
            {
                "name": given.key,
                "label": given.label,
                "file": given.name if given.from_file else "",
                "faces": len(mesh.faces),
                "like": like,
                "positions": packed(codes - drawn[like].codes) if like else packed(codes, differences=True),
                "triangles": None if like else packed_faces(faces.faces),
                "colors": _colors(given, faces),
                "numbers": _numbers(given, faces),
            }
        )
    return packs, drawn


def _fields(
    meshes: Mapping[str, Mesh], frame: _Frame, known: Mapping[str, Mapping[str, Floats]] | None = None
) -> list[Field]:
    with np.errstate(over="ignore"):  # values that overflow count as unknown
        return fields(meshes, frame.unit, known=known or {})


def _packed_field(field: Field, drawn: Mapping[str, _Drawn], *, fewer_steps: bool = False) -> dict[str, Any]:
    """Pack a field; meshes with the same values share them."""
    quantity = field.quantity
    steps = VALUE_STEPS if not fewer_steps else FEWER_STEPS // 2 if quantity.signed else FEWER_STEPS
    packs: list[dict[str, Any]] = []
    rows, of_mesh = dict[int, int](), dict[str, int]()
    for key, values in field.values.items():
        of_mesh[key] = row = rows.setdefault(id(values), len(packs))
        if row == len(packs):
            shown = drawn[key].shown
            whole = in_steps(values[shown.kept_faces if quantity.at == "face" else shown.kept_vertices], steps)
            ways = [packed(whole.codes, differences=differences) for differences in (False, True)]
            codes = min(ways, key=lambda way: len(way["data"]))
            packs.append({"start": whole.start, "step": whole.step, "codes": codes})
    about = {"name": field.name, **quantity._asdict(), "limits": field.limits}
    return {**about, "values": packs, "of": of_mesh}


def _colors(given: Given, drawn: Display) -> dict[str, Any] | None:
    """Pack the vertex colours of a file; split vertices have the colour of their first copy."""
    colors = channels(given.file.vertex_values)
    first = np.unique(given.file.welds, return_index=True)[1]
    if any(len(colors.get(name, ())) != len(given.file.positions) for name in CHANNELS[:3]):
        return None
    rows = np.stack([colors[name][first] for name in CHANNELS[:3]], axis=1)
    return packed(rows[drawn.kept_vertices].astype(np.int32), differences=True)


def _numbers(given: Given, drawn: Display) -> dict[str, Any] | None:
    """Pack the face numbers of the file; None if they count from 0 without gaps."""
    polygons = given.file.triangle_polygons[~given.file.left_out]
    numbers = polygons[drawn.kept_faces] + given.file.counts_from
    return None if (numbers == np.arange(len(numbers))).all() else packed(numbers, differences=True)
