"""
1. What noise is
================

A scanner measures points with an error. On a mesh that error is a displacement of the vertices, and it is small: a
fraction of the length of an edge. What the eye sees is not the displacement but the shade of the faces, which depends
on their normals, and normals suffer far more.
"""

# %%
# Take a cube whose faces we know, and move each vertex by a Gaussian error. Its standard deviation, the *noise
# level*, is given in mean edge lengths, because the same error looks different on coarse and on fine triangles.
import matplotlib.pyplot as plt
import numpy as np

import cascadenorm as cn
from cascadenorm.data_gen.meshing.surface import extent_of
from cascadenorm.data_gen.meshing.tessellation import tessellate
from cascadenorm.data_gen.noise.noise import displacements
from cascadenorm.data_gen.shapes import fields
from cascadenorm.render import HeatMap, render

rng = np.random.default_rng(1)
box = fields.box([0.7, 0.7, 0.7])
clean = tessellate(box, extent_of(box, rng=rng), faces=5000, sharp=True, tessellation="even", rng=rng)


def disturbed(level, kind="gaussian"):
    return clean.moved(clean.vertices + displacements(clean, kind, level=level, rng=np.random.default_rng(0)))


def show(pictures, titles, rows=1):
    _, axes = plt.subplots(rows, len(pictures) // rows, figsize=(9, 3.2 * rows), layout="constrained")
    for axis, picture, title in zip(np.ravel(axes), pictures, titles, strict=True):
        axis.imshow(picture)
        axis.set_title(title, fontsize=10)
        axis.axis("off")


levels = (0.05, 0.15, 0.3)
show([render(disturbed(level), size=(420, 420)) for level in levels], [f"noise level {level}" for level in levels])

# %%
# The normal of a triangle turns by about the height of the error over the height of the triangle. At a level of 0.3,
# where a vertex has moved by half of an edge on average, the normals are off by more than 30 degrees.
errors = np.linspace(0.02, 0.5, 9)
angles = [cn.compare(disturbed(level), clean).normal_error_deg for level in errors]
figure, axis = plt.subplots(figsize=(6, 3.2), layout="constrained")
axis.plot(errors, angles, "o-")
axis.set(xlabel="noise level, mean edge lengths", ylabel="mean angle to the true normals, degrees", ylim=(0, None))

# %%
# Errors of neighbouring faces tend to have opposite signs: a vertex that is too high tilts all faces around it
# outward. So a mean over a neighbourhood cancels most of the error, and filters of normals differ in how they choose
# and weight it. The second picture shows the error of each face as a heat map.
noisy = disturbed(0.2)
cosines = np.einsum("ij,ij->i", noisy.face_normals, clean.face_normals)
error = np.degrees(np.arccos(np.clip(cosines, -1, 1)))
heat = HeatMap(error, "face", (0.0, 60.0), False)
smooth = cn.denoise(noisy, method="mean-normal", iterations=1)
show(
    [render(noisy, size=(420, 420)), render(noisy, size=(420, 420), values=heat), render(smooth, size=(420, 420))],
    ["noisy", "angle to the true normals, 0 to 60°", "after one mean of normals"],
)

# %%
# Not every error is independent from vertex to vertex. Voxels leave steps, coordinates are rounded, and depth cameras
# have similar errors in neighbouring pixels. Errors *correlated* over several edges do not cancel in a mean over one
# ring of faces; a wider mean is needed, which in turn blurs edges. The examples that follow return to this trade-off.
kinds = {
    "normal": "along the normals",
    "impulsive": "a share of the vertices",
    "correlated": "correlated over several edges",
}
pictures = [render(disturbed(0.2, kind), size=(420, 420)) for kind in kinds]
show(pictures, list(kinds.values()))

# %%
# How much noise is there, when the truth is not known? `inspect` estimates the level by what `auto` removes along the
# normals. The estimate is close up to a fifth of an edge, and falls short beyond, where faces fold over.
found = [cn.inspect(disturbed(level), self_intersections=False).noise for level in errors]
figure, axis = plt.subplots(figsize=(6, 3.2), layout="constrained")
axis.plot(errors, errors, color="grey", lw=1, label="true")
axis.plot(errors, found, "o", label="estimated")
axis.set(xlabel="noise level, mean edge lengths", ylabel="estimate")
axis.legend()
