"""Smooth relief that belongs to the shape rather than the error."""

import math

import numpy as np

from cascadenorm.data_gen.noise.sensor import blurred, neighbor_means
from cascadenorm.data_gen.shapes.patterns import noise
from cascadenorm.data_gen.shapes.placement import random_rotation
from cascadenorm.mesh import Mesh, Vectors

WAVELENGTHS = 3.5, 16.0  # wavelengths of patterns and sines, in mean edge lengths
STEEPNESS = 0.01, 0.16  # ratio of the height of patterns and sines to their wavelength
RELIEF_PASSES = 2.0, 40.0  # averages of white noise over neighbours
RELIEF_HEIGHTS = 0.05, 1.0  # root mean square of averaged white noise, in mean edge lengths


def relief(mesh: Mesh, *, rng: np.random.Generator) -> Vectors:
    """Draw a smooth displacement along the normals, 3 to 40 edges wide. Returns (n, 3) displacements in mesh units."""
    kind = rng.choice(["averaged", "pattern", "sines"], p=[0.4, 0.36, 0.24])
    if kind == "averaged":
        white = rng.normal(size=len(mesh.vertices))
        heights = blurred(white, neighbor_means(mesh), round(log_uniform(RELIEF_PASSES, rng=rng)))
        heights *= log_uniform(RELIEF_HEIGHTS, rng=rng) * mesh.mean_edge_length / np.sqrt(np.mean(heights**2))
    else:
        wavelength = log_uniform(WAVELENGTHS, rng=rng) * mesh.mean_edge_length
        height = wavelength * log_uniform(STEEPNESS, rng=rng)
        if kind == "pattern":
            heights = height * noise(wavelength=wavelength, rng=rng)(mesh.vertices)
        else:
            turned = mesh.vertices @ random_rotation(rng=rng) * (2 * np.pi / wavelength) + rng.uniform(0, 2 * np.pi, 3)
            waves = np.sin(turned)
            heights = height * (waves.prod(axis=1) if rng.random() < 0.5 else waves.sum(axis=1) / 2)
    return np.asarray(heights[:, None] * mesh.vertex_normals)


def log_uniform(bounds: tuple[float, float], *, rng: np.random.Generator) -> float:
    """Draw a number whose logarithm is uniform between bounds."""
    low, high = bounds
    return math.exp(rng.uniform(math.log(low), math.log(high)))
