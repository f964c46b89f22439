"""Detection of bumps of the same width that cover a surface, such as a surface around particles."""

from dataclasses import dataclass

import numpy as np

from cascadenorm.detection.error_kind import autocorrelation
from cascadenorm.mesh import Bools, Mesh, connected_components
from cascadenorm.mesh.averages import averaged

PASSES = 64  # averaging passes; bumps up to about 30 mean edge lengths from crest to crest remain
REACH = 24.0  # largest distance, in mean edge lengths, at which the correlation of heights is measured
ALTERNATION = -0.18  # largest autocorrelation halfway between crests; scans and reconstructions have -0.15 or more
LEAST_BUMP_HEIGHT = 0.01  # root mean square, in mean edge lengths, below which a surface is smooth
NARROWEST_BUMPS = 5.0  # smallest width in mean edge lengths; `auto` removes narrower bumps by itself if they are error
FEWEST_BUMPS = 15  # smallest number of bumps on a component; fewer belong to the shape
COVERING = 0.9  # smallest number of bumps or hollows, relative to the number that covers a component
LEAST_PART = 5  # smallest number of vertices of a bump or hollow; smaller ones are noise
BUMP_WIDTH = 1.2  # width of a bump relative to the distance at which the autocorrelation is lowest


@dataclass(frozen=True, kw_only=True)
class Bumps:
    """Bumps of the same width that cover a mesh. They may be an error or belong to the shape."""

    width: float  # in mean edge lengths


def bumps(mesh: Mesh) -> Bumps | None:
    """Find bumps of the same width that cover the mesh; return None if there are none.

    Heights above the smoothed surface, without their own smooth part, alternate between bumps and hollows. If all of
    these have about the same width, the autocorrelation of the heights is clearly negative at half the distance between
    crests. On other surfaces, where widths vary, it only falls to about zero. It is also negative between the rounded
    edges of a box, but these are a few long ridges, whereas bumps, or the hollows between them, are separate.
    """
    edge, topology = mesh.mean_edge_length, mesh.topology
    inside = topology.used_vertices & ~topology.boundary_vertices
    if not edge > 0 or not inside.any():
        return None
    smooth = averaged(mesh.vertices, topology.vertex_neighbors, PASSES)
    heights = np.einsum("ij,ij->i", mesh.vertices - smooth, mesh.moved(smooth).vertex_normals) / edge
    heights -= averaged(heights, topology.vertex_neighbors, PASSES)
    size = np.sqrt(np.mean(heights[inside] ** 2))
    if not size >= LEAST_BUMP_HEIGHT:
        return None
    at, correlation = autocorrelation(mesh.vertices[inside] / edge, heights[inside], REACH)
    rising = np.flatnonzero(np.diff(correlation[1:]) > 0) + 1
    if not len(rising) or correlation[rising[0]] > ALTERNATION:
        return None
    half_wave = float(at[rising[0]])
    areas = np.bincount(topology.face_components, mesh.areas)
    largest = inside & (topology.components == np.argmax(areas))
    covering = areas.max() / (2 * half_wave * edge) ** 2
    count = max(_parts(mesh, largest & (sign * heights > size)) for sign in (1, -1))
    width, least = BUMP_WIDTH * half_wave, max(FEWEST_BUMPS, COVERING * covering)
    return Bumps(width=width) if width >= NARROWEST_BUMPS and covering >= FEWEST_BUMPS and count >= least else None


def _parts(mesh: Mesh, chosen: Bools) -> int:
    """Return the number of connected sets of chosen vertices, without those of fewer than LEAST_PART vertices."""
    edges = mesh.topology.edges
    parts = connected_components(edges[chosen[edges].all(axis=1)], len(mesh.vertices))
    return int(np.count_nonzero(np.bincount(parts[chosen]) >= LEAST_PART))
