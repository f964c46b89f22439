"""
2. Diffusion
============

The oldest idea is to let the error spread and cancel, as heat does. The vertices follow the equation

.. math:: \\frac{\\partial x}{\\partial t} = \\lambda \\Delta x ,

in which the Laplacian :math:`\\Delta x` is the difference between a vertex and the mean of its neighbours.
"""

# %%
# A step of *umbrella smoothing* moves each vertex part of the way to that mean. Noise goes, but so do the edges, and
# the cube shrinks.
import matplotlib.pyplot as plt
import numpy as np

import cascadenorm as cn
from cascadenorm.data_gen.meshing.surface import extent_of
from cascadenorm.data_gen.meshing.tessellation import tessellate
from cascadenorm.data_gen.noise.noise import displacements
from cascadenorm.data_gen.shapes import fields
from cascadenorm.render import render

rng = np.random.default_rng(1)
box = fields.box([0.7, 0.7, 0.7])
clean = tessellate(box, extent_of(box, rng=rng), faces=5000, sharp=True, tessellation="even", rng=rng)
noisy = clean.moved(clean.vertices + displacements(clean, "gaussian", level=0.2, rng=rng))


def show(meshes, titles):
    _, axes = plt.subplots(1, len(meshes), figsize=(9, 3.2), layout="constrained")
    for axis, mesh, title in zip(axes, meshes, titles, strict=True):
        axis.imshow(render(mesh, size=(420, 420)))
        axis.set_title(title, fontsize=10)
        axis.axis("off")


steps = (0, 5, 100)
show(
    [cn.denoise(noisy, method="laplacian", iterations=count) for count in steps],
    [f"{count} steps" for count in steps],
)

# %%
# The error first falls and then rises: the best time to stop depends on the noise, which is unknown in practice.
# The volume decreases throughout.
counts = (0, 1, 2, 3, 5, 8, 12, 20, 35, 60, 100)
flows = {"laplacian": [], "taubin": []}
for count in counts:
    for name, measured in flows.items():
        measured.append(cn.compare(cn.denoise(noisy, method=name, iterations=count), clean))
figure, (left, right) = plt.subplots(1, 2, figsize=(9, 3.2), layout="constrained")
for name, measured in flows.items():
    left.plot(counts, [one.normal_error_deg for one in measured], "o-", label=name)
    right.plot(counts, [one.volume_ratio for one in measured], "o-", label=name)
left.set(xlabel="steps", ylabel="mean angle to the true normals, degrees")
right.set(xlabel="steps", ylabel="volume over the true volume")
left.legend()

# %%
# Taubin's remedy (1995) for the shrinkage, the second curve, alternates a step inward with a slightly longer one
# outward: noise goes, low frequencies stay. The edges are rounded all the same, since the filter does not distinguish
# edges from noise.
#
# Explicit steps are stable only up to a length: each multiplies the highest frequency by :math:`1 - \lambda k`. An
# *implicit* step solves :math:`(1 + \lambda K) x' = x` with a sparse matrix and is stable at any length (Desbrun et
# al. 1999).
#
# With cotangent weights the Laplacian of the surface itself is the mean curvature, :math:`\Delta x = -2 H n`, and the
# flow has a formula for a sphere: :math:`r(t)^2 = r_0^2 - 4 \lambda t`. The implementation follows it; implicit steps
# are of first order in time, so long ones lag behind.
sphere = fields.sphere(radius=0.8)
ball = tessellate(sphere, extent_of(sphere, rng=rng), faces=3000, sharp=False, tessellation="even", rng=rng)
step, count = 1.0, 12  # squared mean edge lengths
radii, times = [], np.arange(count + 1) * step * ball.mean_edge_length**2
for steps in range(count + 1):
    moved = cn.denoise(ball, method="mean-curvature-flow", step=step, iterations=steps)
    radii.append(np.linalg.norm(moved.vertices - moved.vertices.mean(axis=0), axis=1).mean())
figure, axis = plt.subplots(figsize=(6, 3.2), layout="constrained")
axis.plot(times, np.sqrt(radii[0] ** 2 - 4 * times), color="grey", label="formula")
axis.plot(times, radii, "o", label="mean-curvature-flow")
axis.set(xlabel="time λt", ylabel="radius")
axis.legend()

# %%
# *Anisotropic* diffusion (Clarenz, Diewald and Rumpf 2000) lets the error spread along an edge but not across it. It
# has to find the edges in the noisy mesh first.
show(
    [
        cn.denoise(noisy, method="mean-curvature-flow"),
        cn.denoise(noisy, method="anisotropic-diffusion"),
        cn.denoise(noisy, method="prescribed-mean-curvature"),
    ],
    ["mean curvature flow", "anisotropic diffusion", "prescribed mean curvature"],
)
