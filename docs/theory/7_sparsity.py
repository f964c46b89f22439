"""
7. Sparsity
===========

A machine part is flat almost everywhere, and bent at a few edges only. Of all surfaces near the measurement, take the
one with the *fewest* bends. Counting is what a norm does with the exponent zero,

.. math:: |d|_p^p = \\sum_e |d_e|^p , \\qquad |d|_0 = \\#\\{e : d_e \\neq 0\\} ,

and between the square and the count lies the sum of the absolute values.
"""

# %%
# What do the exponents prefer? The same rise in one step, or in many small ones: the square is least when it is
# spread, the absolute value is the same for both, the count is least for one step.
import matplotlib.pyplot as plt
import numpy as np

import cascadenorm as cn
from cascadenorm.data_gen.meshing.surface import extent_of
from cascadenorm.data_gen.meshing.tessellation import tessellate
from cascadenorm.data_gen.noise.noise import displacements
from cascadenorm.data_gen.shapes import fields
from cascadenorm.render import render

steps = np.arange(1, 21)
figure, axis = plt.subplots(figsize=(6, 3.2), layout="constrained")
axis.plot(steps, steps * (1 / steps) ** 2, "o-", label="Σ d²")
axis.plot(steps, steps * (1 / steps), "o-", label="Σ |d|")
axis.plot(steps, steps / 20, "o-", label="number of d ≠ 0, over 20")
axis.set(xlabel="steps that share a rise of 1", ylabel="price")
axis.legend()

# %%
# On a mesh :math:`d_e` is how much the surface bends across an edge. He and Schaefer (2013) count those edges (`l0`);
# Zhang et al. (2015) sum the absolute differences of the normals (`tv-normal`, *total variation*).
rng = np.random.default_rng(1)
body = fields.difference(fields.box([0.7, 0.5, 0.7]), fields.cylinder(radius=0.3, half_height=1.0))
clean = tessellate(body, extent_of(body, rng=rng), faces=6000, sharp=True, tessellation="even", rng=rng)
noisy = clean.moved(clean.vertices + displacements(clean, "gaussian", level=0.2, rng=rng))


def show(meshes):
    _, axes = plt.subplots(1, len(meshes), figsize=(9, 9 / len(meshes)), layout="constrained")
    for axis, (title, mesh) in zip(axes, meshes.items(), strict=True):
        axis.imshow(render(mesh, size=(400, 400)))
        axis.set_title(f"{title}, {cn.compare(mesh, clean).normal_error_deg:.1f}°", fontsize=10)
        axis.axis("off")


results = {name: cn.denoise(noisy, method=name) for name in ("laplacian", "tv-normal", "l0")}
show(results)


# %%
# The angles across all edges, sorted. The true part has large ones at its edges, small ones around the hole, and zero
# elsewhere. Squares leave many small bends, the absolute value fewer, the count fewest, and the large ones survive.
def bends(mesh):
    first, second = mesh.topology.face_pairs.T
    cosines = np.einsum("ij,ij->i", mesh.face_normals[first], mesh.face_normals[second])
    return np.sort(np.degrees(np.arccos(np.clip(cosines, -1, 1))))[::-1]


figure, axis = plt.subplots(figsize=(7, 3.6), layout="constrained")
for title, mesh in {"noisy": noisy, **results, "true": clean}.items():
    axis.semilogy(np.linspace(0, 100, len(bends(mesh))), bends(mesh).clip(1e-2), label=title)
axis.set(xlabel="edges, %", ylabel="angle across the edge, degrees", ylim=(1e-2, 180))
axis.legend()

# %%
# Sparsity is an assumption about the shape, which a sphere violates: it bends a little everywhere. Counting
# turns it into facets, and total variation into a staircase of the normals. The learned method has seen both kinds of
# shapes.
ball = fields.sphere(radius=0.8)
clean = tessellate(ball, extent_of(ball, rng=rng), faces=6000, sharp=False, tessellation="even", rng=rng)
noisy = clean.moved(clean.vertices + displacements(clean, "gaussian", level=0.2, rng=rng))
show({name: cn.denoise(noisy, method=name) for name in ("l0", "tv-normal", "auto")})
