"""The vertex update in passes over patches, each of as many sweeps as its halo allows."""

from typing import Any

from cascadenorm.baselines.vertex_update import recover_vertices
from cascadenorm.streaming.layers import Layer
from cascadenorm.streaming.passes import Passes, View

WIDTH = 70
"""Edges of the widest halo, about that of the first stage of `auto`; a pass makes as many sweeps as fit into it."""
SWEEP = 0.4
"""Cost of a sweep, for the progress."""


def swept(
    passes: Passes,
    name: str,
    before: Layer | None,
    normals: Layer,
    *,
    sweeps: int,
    facts: dict[str, float],
    **settings: Any,
) -> Layer | None:
    """Do what `recover_vertices` does; return where the positions are.

    Parameters
    ----------
    name : of what the sweeps belong to, as names of passes begin with it
    before, normals : positions of the vertices, None as they were given, and the normals that the faces shall take
    facts : about the whole with these positions, see `Mesh.with_facts`
    settings : of `recover_vertices`
    """
    after, groups = before, passes.store.whole.groups
    at_once = max(1, WIDTH // groups)
    for first in range(0, sweeps, at_once):
        count = min(at_once, sweeps - first)
        title = f"{name} sweeps {first + count}"
        now, after = after, passes.positions(title)

        def sweep(view: View, now: Layer | None = now, after: Layer = after, count: int = count) -> None:
            mesh, wanted = view.mesh_at(before, **facts), view.of_faces(normals)
            moved = recover_vertices(mesh, wanted, sweeps=count, start=view.vertices(now), **settings)
            view.keep_vertices(after, moved)

        passes.run(title, count * groups + 2, sweep, count * SWEEP)
        if now is not None and now is not before:
            now.remove()
    return after
