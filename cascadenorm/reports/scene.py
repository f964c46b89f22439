"""Everything that the viewer shows, as one object of JSON."""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from cascadenorm.evaluation.fields import Field, fields
from cascadenorm.io.colors import CHANNELS, channels
from cascadenorm.mesh import scale_between, scaled_alike
from cascadenorm.render import Camera
from cascadenorm.reports.display import Display, display
from cascadenorm.reports.given import Given
from cascadenorm.reports.packing import in_steps, packed, packed_faces
from cascadenorm.reports.places import Place

FORMAT = 1
LEVELS, FINE_LEVELS = (1 << 16) - 1, (1 << 24) - 1
FEWEST = 30
"""Levels along a mean edge below which FINE_LEVELS are used: a part far away makes the bounding box large."""


def scene(shown: Sequence[Given], places: Sequence[Place], *, own: Field | None = None) -> dict[str, Any]:
    """Pack meshes, what is known of their faces and vertices, values of the caller's own, and places to look at.

    Positions are whole numbers from 0 to LEVELS, or FINE_LEVELS, in each direction of the bounding box of all meshes;
    a mesh with the faces of an earlier one is that one and the displacements of its vertices.
    """
    meshes = dict(zip((given.key for given in shown), scaled_alike(*(given.mesh for given in shown)), strict=True))
    unit = scale_between(shown[0].mesh, meshes[shown[0].key])
    corners = np.concatenate([mesh.vertices[mesh.topology.used_vertices] for mesh in meshes.values()])
    lower, extent = corners.min(axis=0), np.ptp(corners, axis=0)
    edge = min(mesh.mean_edge_length for mesh in meshes.values())
    levels = LEVELS if edge * LEVELS >= FEWEST * extent.max() else FINE_LEVELS
    displays: dict[str, Display] = {}
    packed_meshes, codes = [], dict[str, NDArray[np.int64]]()
    for given in shown:
        mesh = meshes[given.key]
        like = next((key for key in codes if np.array_equal(meshes[key].faces, mesh.faces)), None)
        displays[given.key] = drawn = displays[like] if like else display(mesh)
        place = np.divide(mesh.vertices - lower, extent, out=np.zeros_like(mesh.vertices), where=extent > 0)
        codes[given.key] = np.rint(place[drawn.kept_vertices] * levels).astype(np.int64)
        packed_meshes.append(
            {
                "name": given.key,
                "label": given.label,
                "file": given.name,
                "faces": len(mesh.faces),
                "like": like,
                "positions": packed(codes[given.key] - codes[like])
                if like
                else packed(codes[given.key], differences=True),
                "triangles": None if like else packed_faces(drawn.faces),
                "colors": _colors(given, drawn),
                "numbers": _numbers(given, drawn),
            }
        )
    camera = Camera.looking_at(meshes[shown[-1].key])
    with np.errstate(over="ignore"):  # what is too large for a number is no value
        quantities = [*fields(meshes, unit), *([own] if own else [])]
    return {
        "format": FORMAT,
        "lower": (lower * unit).tolist(),
        "extent": (extent * unit).tolist(),
        "levels": levels,
        "view": {
            "from": camera.axes[2].tolist(),
            "target": (camera.center * unit).tolist(),
            "reach": [reach * unit for reach in camera.reach],
        },
        "meshes": packed_meshes,
        "fields": [_packed_field(field, displays) for field in quantities],
        "places": [place._asdict() for place in places],
    }


def _packed_field(field: Field, displays: Mapping[str, Display]) -> dict[str, Any]:
    """Pack a field; meshes that have the same values share them."""
    quantity = field.quantity
    packs: list[dict[str, Any]] = []
    rows: list[NDArray[np.float64]] = []
    of_mesh = {}
    for key, values in field.values.items():
        row = next((i for i, known in enumerate(rows) if known is values), len(rows))
        of_mesh[key] = row
        if row == len(rows):
            rows.append(values)
            drawn = displays[key]
            steps = in_steps(values[drawn.kept_faces if quantity.at == "face" else drawn.kept_vertices])
            packs.append({"start": steps.start, "step": steps.step, "codes": packed(steps.codes)})
    about = {"name": field.name, **quantity._asdict(), "limits": field.limits}
    return {**about, "values": packs, "of": of_mesh}


def _colors(given: Given, drawn: Display) -> dict[str, Any] | None:
    """Pack the vertex colours of a file, those of the first copy where it splits vertices."""
    colors = channels(given.file.content().vertex_values)
    first = np.unique(given.file.welds, return_index=True)[1]
    if any(len(colors.get(name, ())) != len(given.file.positions) for name in CHANNELS[:3]):
        return None
    rows = np.stack([colors[name][first] for name in CHANNELS[:3]], axis=1)
    return packed(rows[drawn.kept_vertices].astype(np.int64), differences=True)


def _numbers(given: Given, drawn: Display) -> dict[str, Any] | None:
    """Pack the numbers that the file gives to the faces, where they do not simply count from 0."""
    polygons = given.file.triangle_polygons[~given.file.left_out]
    numbers = polygons[drawn.kept_faces] + given.file.counts_from
    return None if (numbers == np.arange(len(numbers))).all() else packed(numbers, differences=True)
