"""Evidence for noise in how far the first stage of a network turns the faces of a mesh.

Noise turns all faces of a neighbourhood. A network that takes detail of the shape for noise turns some of them.
"""

import numpy as np

from cascadenorm.mesh import Floats, Mesh, Vectors, angles_between, face_area_vectors, unit
from cascadenorm.mesh.averages import averaged, averaged_around

LITTLE = np.radians((2.0, 3.0))
"""Mean angles over a component between which the evenness of the angles loses its influence. The vertex network turns
clean meshes by 2.3 degrees at most, and meshes with noise of 0.03 mean edge lengths by about 3."""
EVEN = (0.5, 0.8)
"""Evenness of the angles between which the evidence rises from 0 to 1. White noise has an evenness of 0.86."""
TINY = np.radians((0.1, 0.2))
"""Mean angles around a vertex between which the evidence rises from 0 to 1. The networks tell apart normals that
differ by half a degree or more."""
ROUNDS = 7  # averaging rounds over vertex neighbours; the means extend as far as the widest context features


def turning_angles(mesh: Mesh, normals: Vectors) -> Floats:
    """Return the angle between the normal of each face and a given one in radians, (m,); 0 for faces without area."""
    ours = unit(face_area_vectors(mesh.vertices, mesh.faces))  # not cached, since the network needs memory
    return angles_between(ours, normals, undefined=0.0)


def component_angles(mesh: Mesh, angles: Floats) -> Floats:
    """Return the mean of the angles of the faces, (m,), over each component, (c,); 0 for components without faces."""
    components = mesh.topology.face_components
    return np.asarray(np.bincount(components, angles) / np.maximum(np.bincount(components), 1))


def noise_evidence(mesh: Mesh, angles: Floats) -> Floats:
    """Return how strongly the angles around each vertex indicate noise, (n,) from 0 to 1.

    The angles in radians, (m,), are those by which the first stage turns the faces, see `turning_angles`. The result is
    1 on components with a mean angle above LITTLE. Otherwise it depends on the mean of the angles a around the vertex
    and on their evenness, (mean √a)⁴ / (mean a)², which is 1 if they are equal and tends to 0 if few of them are large.
    """
    topology = mesh.topology
    components = topology.face_components
    overall = _rise(component_angles(mesh, angles), *LITTLE)
    if np.all(overall == 1):
        return np.ones(len(mesh.vertices))
    powers = np.stack([np.sqrt(angles), angles], axis=1)
    means = averaged(averaged_around(powers, topology.vertex_faces), topology.vertex_neighbors, ROUNDS)
    evenness = means[:, 0] ** 4 / np.maximum(means[:, 1] ** 2, np.finfo(float).tiny)
    evidence = _rise(evenness, *EVEN) * _rise(means[:, 1], *TINY)
    corners = mesh.faces.ravel()
    evidence[corners] = np.maximum(evidence[corners], np.repeat(overall[components], 3))
    return evidence


def _rise(values: Floats, low: float, high: float) -> Floats:
    """Map values linearly, so that those up to `low` become 0 and those from `high` on become 1."""
    return np.clip((values - low) / (high - low), 0, 1)
