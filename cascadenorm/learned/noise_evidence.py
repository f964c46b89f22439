"""Evidence for noise in how far the first stage of a network turns the faces of a mesh.

Noise turns all faces of a neighbourhood. A network that takes detail of the shape for noise turns some of them, or
turns them further than the noise of the mesh explains.
"""

import numpy as np

from cascadenorm.detection.noise_level import component_noise
from cascadenorm.mesh import Floats, Mesh, Vectors, angles_between, face_area_vectors, marked, unit
from cascadenorm.mesh.averages import averaged, averaged_around

LITTLE = np.radians((2.0, 3.0))
"""Mean angles over a component between which the evenness of the angles loses its influence. The vertex network turns
clean meshes by 2.3 degrees at most, and meshes with noise of 0.03 mean edge lengths by about 3."""
EVEN = (0.5, 0.8)
"""Evenness of the angles between which the evidence rises from 0 to 1. White noise has an evenness of 0.86."""
TINY = np.radians((0.1, 0.2))
"""Mean angles around a vertex between which the evidence rises from 0 to 1. The networks tell apart normals that
differ by half a degree or more."""
EXPLAINED = (0.5, 0.8)
"""Ratios between the angles that the noise explains and those of the network between which the evidence rises from 0 to
1. The first stage removes most of the noise, so that noise has ratios of about 1 or more."""
LOCAL = np.radians((3.0, 5.0))
"""Mean angles around a vertex between which the ratio loses its influence, so that noise on a part of a component is
evidence there."""
ROUNDS = 7  # averaging rounds over vertex neighbours; the means extend as far as the widest context features


def turning_angles(mesh: Mesh, normals: Vectors) -> Floats:
    """Return the angle between the normal of each face and a given one in radians, (m,); 0 for faces without area."""
    ours = unit(face_area_vectors(mesh.vertices, mesh.faces))  # not cached, since the network needs memory
    return angles_between(ours, normals, undefined=0.0)


def component_angles(mesh: Mesh, angles: Floats) -> Floats:
    """Return the mean of the angles of the faces, (m,), over each component, (c,); 0 for components without faces."""
    components, count = mesh.topology.face_components, mesh.topology.component_count
    number = np.bincount(components, minlength=count)
    return np.asarray(np.bincount(components, angles, minlength=count) / np.maximum(number, 1))


def noise_evidence(mesh: Mesh, angles: Floats, *, white: bool = False) -> Floats:
    """Return how strongly the angles around each vertex indicate noise, (n,) from 0 to 1.

    The angles in radians, (m,), are those by which the first stage turns the faces, see `turning_angles`. The result is
    1 on components with a mean angle above LITTLE. Otherwise it depends on the mean of the angles a around the vertex
    and on their evenness, (mean √a)⁴ / (mean a)², which is 1 if they are equal and tends to 0 if few of them are large.
    If the noise is `white`, that is, independent between vertices, it also depends on the ratio between the angles that
    the noise of the component explains and the actual ones.
    """
    topology = mesh.topology
    overall = _rise(component_angles(mesh, angles), *LITTLE)
    if np.all(overall == 1):
        return np.ones(len(mesh.vertices))
    root, mean = _averages(mesh, np.sqrt(angles), angles)
    evidence = _rise(root**4 / np.maximum(mean**2, np.finfo(float).tiny), *EVEN) * _rise(mean, *TINY)
    turned = evidence > 0
    if white and turned.any():
        noise = component_noise(mesh, marked(topology.components[turned], topology.component_count) & (overall < 1))
        (explained,) = _averages(mesh, explained_angles(mesh, noise[topology.face_components]))
        ratio = explained[turned] / mean[turned]
        evidence[turned] *= np.maximum(_rise(ratio, *EXPLAINED), _rise(mean[turned], *LOCAL))
    corners = mesh.faces.ravel()
    evidence[corners] = np.maximum(evidence[corners], np.repeat(overall[topology.face_components], 3))
    return evidence


def _averages(mesh: Mesh, *values: Floats) -> Floats:
    """Return the means of values of the faces, (m,) each, around each vertex, (p, n)."""
    around = averaged_around(np.stack(values, axis=1), mesh.topology.vertex_faces)
    return averaged(around, mesh.topology.vertex_neighbors, ROUNDS).T


def explained_angles(mesh: Mesh, noise: Floats) -> Floats:
    """Return the mean angle in radians by which white noise turns each face, (m,); right angles where it is unknown.

    Noise of deviation s, (m,), changes the slope of a face of area A and sides l by s √(Σ l²) / (2 A), as a root mean
    square.
    """
    corners = mesh.corners
    sides = np.square(corners - np.roll(corners, 1, axis=1)).sum(axis=(1, 2))
    angles = np.arctan2(np.sqrt(np.pi / 4 * sides) * noise, 2 * mesh.areas)
    return np.where(np.isnan(noise), np.pi / 2, angles)


def _rise(values: Floats, low: float, high: float) -> Floats:
    """Map values linearly, so that those up to `low` become 0 and those from `high` on become 1."""
    return np.clip((values - low) / (high - low), 0, 1)
