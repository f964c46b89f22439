r"""
6. Normals first
================

Since about 2002 the most accurate filters work in two steps: filter the normals of the faces, then move the vertices
until the faces have these normals. Why is the detour worth it?
"""

# %%
# A flat surface with an edge is *piecewise constant* in its normals. In its positions it is only piecewise linear,
# and its noise is small beside its slopes. Along a line across the edge of a roof:
import matplotlib.pyplot as plt
import numpy as np

import cascadenorm as cn
from cascadenorm.baselines.bilateral_normal import bilateral_normals
from cascadenorm.baselines.vertex_update import recover_vertices
from cascadenorm.data_gen.meshing.surface import extent_of
from cascadenorm.data_gen.meshing.tessellation import tessellate
from cascadenorm.data_gen.noise.noise import displacements
from cascadenorm.data_gen.shapes import fields
from cascadenorm.render import render

rng = np.random.default_rng(1)
x = np.linspace(-1, 1, 81)
height = 0.6 - 0.6 * np.abs(x) + rng.normal(scale=0.006, size=81)
slope = np.diff(height) / np.diff(x)
figure, (left, right) = plt.subplots(1, 2, figsize=(9, 3), layout="constrained")
left.plot(x, height, ".-")
left.set_title("positions")
right.plot((x[1:] + x[:-1]) / 2, slope, ".-")
right.set_title("slopes")

# %%
# On a mesh the normals of the faces are points on the unit sphere. Those of a cube are six points. Noise spreads each
# into a cloud, and a filter contracts the clouds again. Here they are seen along the z axis.
box = fields.box([0.7, 0.7, 0.7])
clean = tessellate(box, extent_of(box, rng=rng), faces=5000, sharp=True, tessellation="even", rng=rng)
noisy = clean.moved(clean.vertices + displacements(clean, "gaussian", level=0.2, rng=rng))
filtered = {count: bilateral_normals(noisy, sigma_s=0.7, sigma_r=0.45, iterations=count) for count in (0, 1, 3, 10)}
turn, _ = np.linalg.qr(np.random.default_rng(8).normal(size=(3, 3)))
figure, axes = plt.subplots(1, 4, figsize=(9, 2.6), layout="constrained")
for axis, (count, normals) in zip(axes, filtered.items(), strict=True):
    axis.plot(*(normals @ turn)[:, :2].T, ".", ms=1.5)
    axis.set_title(f"{count} passes", fontsize=10)
    axis.set_aspect("equal")
    axis.axis("off")

# %%
# Filtered normals belong to no surface: three vertices have nine coordinates, but they serve all faces around them.
# The vertex update (Sun et al. 2007) projects each vertex onto the planes of its faces, and averages the displacements:
#
# .. math:: x_i \leftarrow x_i + \frac{1}{N_i} \sum_{f \ni i} \langle n_f,\, c_f - x_i \rangle\, n_f .
#
# Few sweeps leave the noise of the positions. After about twenty the error no longer falls: further ones
# follow the errors of the filtered normals.
sweeps = (0, 1, 2, 4, 8, 16, 32, 64)
angle, off = [], []
for count in sweeps:
    moved = noisy.moved(recover_vertices(noisy, filtered[10], sweeps=count))
    measured = cn.compare(moved, clean)
    angle.append(measured.normal_error_deg)
    off.append(measured.vertex_error_edges)
figure, (left, right) = plt.subplots(1, 2, figsize=(9, 3), layout="constrained")
left.plot(sweeps, angle, "o-")
left.set(xlabel="sweeps", ylabel="angle to the true normals, degrees", xscale="symlog")
right.plot(sweeps, off, "o-")
right.set(xlabel="sweeps", ylabel="distance to the true surface, edges", xscale="symlog")

# %%
# Giving the vertex update the *true* normals bounds what a filter can achieve. The remaining error is that of the
# second step alone; the difference from the result with filtered normals is the error of the first step.
truth = noisy.moved(recover_vertices(noisy, clean.face_normals, sweeps=50))
ours = noisy.moved(recover_vertices(noisy, filtered[10], sweeps=8))
figure, axes = plt.subplots(1, 3, figsize=(9, 3.2), layout="constrained")
for axis, mesh, title in zip(axes, (noisy, ours, truth), ("noisy", "filtered normals", "true normals"), strict=True):
    axis.imshow(render(mesh, size=(400, 400)))
    axis.set_title(f"{title}, {cn.compare(mesh, clean).normal_error_deg:.1f}°", fontsize=10)
    axis.axis("off")
