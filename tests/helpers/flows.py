"""What flows over a mesh are compared with."""

from functools import cache

import numpy as np
from scipy.linalg import eigh
from shapes import grid

from cascadenorm.geometry.laplacians import laplacian_of
from cascadenorm.mesh import Mesh


@cache
def spectrum(mesh, weights):
    operator = laplacian_of(mesh, weights)
    return *eigh(operator.stiffness.toarray(), np.diag(operator.mass)), operator.mass[:, None]


def spectrally(mesh, weights, transfer):
    """Scale the part of the vertices along each eigenvector of the Laplacian by transfer(eigenvalue)."""
    values, vectors, mass = spectrum(mesh, weights)
    return vectors @ (transfer(values)[:, None] * (vectors.T @ (mass * mesh.vertices)))


def distance_to_cube(points):
    return abs(abs(points).max(axis=1) - 1)


def cylinder(around, along):
    """Open cylinder with edges of about length 1 around the z axis."""
    plane = grid(along, around)
    x, y, _ = plane.vertices.T
    angle, radius = 2 * np.pi * x / around, around / (2 * np.pi)
    kept = np.flatnonzero(x < around)
    number = np.zeros(len(x), int)
    number[kept] = np.arange(len(kept))
    number[x == around] = number[x == 0]
    vertices = np.stack([radius * np.cos(angle), radius * np.sin(angle), y], axis=1)
    return Mesh(vertices[kept], number[plane.faces]), radius
