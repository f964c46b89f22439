"""The key figures of a report: noise, angle, volume and faults such as spikes, before and after."""

from collections.abc import Mapping, Sequence

import numpy as np

from cascadenorm.api.inspection import Inspection
from cascadenorm.api.opened_files import DenoisingSummary
from cascadenorm.errors import counted
from cascadenorm.geometry.metrics import Measures, angles_at_faces
from cascadenorm.mesh import Mesh
from cascadenorm.reports.facts import count_of
from cascadenorm.reports.given import Given
from cascadenorm.reports.page import Tile

InspectedMeshes = Sequence[tuple[Given, Inspection]]
MeasuredMeshes = Sequence[tuple[Given, Measures]]


def key_figures(
    inspected: InspectedMeshes, measured: MeasuredMeshes, done: DenoisingSummary | None, meshes: Mapping[str, Mesh]
) -> list[Tile]:
    """Return the tiles at the top of a report; values of two meshes are shown as before → after.

    `meshes` are the shown meshes by key, as `scaled_meshes` returns them.
    """
    found = [inspection for _, inspection in inspected]
    noise = ("unknown" if one.noise is None else f"{one.noise:.2g}" for one in found)
    folded = "\N{NO-BREAK SPACE}→\N{NO-BREAK SPACE}".join(f"{one.folded_edges:,}" for one in found)
    if done is not None:
        note = f"mean edge lengths on average, {done.largest_displacement:.3g} at most"
        last = Tile("Displacement", (f"{done.mean_displacement:.3g}",), note)
    else:
        vertices = "vertex" if found[-1].vertices == 1 else "vertices"
        last = Tile("Faces", (f"{found[-1].faces:,}",), f"{found[-1].vertices:,} {vertices}")
    return [
        Tile("Noise", tuple(noise), "mean edge lengths"),
        *_angle(meshes, measured),
        _volume(found),
        Tile("Self-intersecting faces", tuple(count_of(one.crossing_faces) for one in found)),
        Tile("Spikes", tuple(count_of(one.spikes) for one in found), f"vertices; folded edges: {folded}"),
        last,
    ]


def headline(inspected: InspectedMeshes, done: DenoisingSummary | None) -> list[str]:
    """Return the kind of error and of surface of the first mesh, and the method, worded as by `denoise`."""
    known = inspected[0][1] if done is None else done
    parts = {"Kind of error": known.error, "Treated as": known.treated_as}
    method = {} if done is None else {"Method": f"{done.method}, {done.seconds:.1f} s"}
    line = " ".join(f"{name}: {value}." for name, value in {**parts, **method}.items() if value is not None)
    return [line] if line else []


def _angle(meshes: Mapping[str, Mesh], measured: MeasuredMeshes) -> list[Tile]:
    """Return the mean angle to the truth, or to the input if there is no truth."""
    if measured:
        values = tuple(f"{measures.normal_error_deg:.2f}°" for _, measures in measured)
        return [Tile("Angle to the truth", values, "mean over the faces")]
    if len(meshes) < 2 or not np.array_equal(meshes["before"].faces, meshes["after"].faces):
        return []
    angles = angles_at_faces(meshes["after"].face_normals, meshes["before"].face_normals)
    known = angles[~np.isnan(angles)]
    value = f"{known.mean():.2f}°" if len(known) else "unknown"
    return [Tile("Angle to the input", (value,), "mean over the faces")]


def _volume(found: Sequence[Inspection]) -> Tile:
    volumes = [one.volume for one in found]
    known = [volume for volume in volumes if volume is not None]
    if len(known) < len(volumes):
        loops = found[-1].boundary_loops
        return Tile("Volume", ("none",), f"open, {counted(loops, 'boundary loop')}" if loops else "not closed")
    if len(known) == 2 and known[0]:
        change = 100 * (known[1] / known[0] - 1)
        return Tile("Volume", (f"{change:+.2f} %".replace("-", "−"),), f"{known[0]:.5g} → {known[1]:.5g} mesh units³")
    return Tile("Volume", (f"{known[-1]:.5g}",), "mesh units³")
