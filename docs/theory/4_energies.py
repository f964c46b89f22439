"""
4. Energies
===========

A flow says what to do next; an *energy* says what one wants. The denoised surface is the minimum of a sum of two
terms, one for smoothness and one for staying near the measurement:

.. math:: E(x) = \\tfrac{1}{2} \\int |\\nabla x|^2 + \\tfrac{\\alpha}{2} \\int |x - x^*|^2 .
"""

# %%
# Setting the derivative to zero gives :math:`(1 + \frac{1}{\alpha} K)\, x = x^*`, which is one implicit step of
# diffusion of the length :math:`1/\alpha`. The weight of the data and the time of the flow are the same parameter.
import matplotlib.pyplot as plt
import numpy as np

import cascadenorm as cn
from cascadenorm.data_gen.meshing.surface import extent_of
from cascadenorm.data_gen.meshing.tessellation import tessellate
from cascadenorm.data_gen.noise.noise import displacements
from cascadenorm.data_gen.shapes import fields
from cascadenorm.geometry.laplacians import cotangent_laplacian
from cascadenorm.render import render

rng = np.random.default_rng(1)
shape = fields.union(
    fields.box([0.5, 0.5, 0.5]), fields.cylinder(radius=0.3, half_height=0.9), blend="round", radius=0.12
)
clean = tessellate(shape, extent_of(shape, rng=rng), faces=5000, sharp=True, tessellation="even", rng=rng)
noisy = clean.moved(clean.vertices + displacements(clean, "gaussian", level=0.2, rng=rng))


def show(meshes, titles):
    _, axes = plt.subplots(1, len(meshes), figsize=(9, 9 / len(meshes)), layout="constrained")
    for axis, mesh, title in zip(axes, meshes, titles, strict=True):
        axis.imshow(render(mesh, size=(400, 400)))
        axis.set_title(title, fontsize=10)
        axis.axis("off")


# %%
# The two terms along the minima for many weights, the *L-curve*: on it nothing can be made smoother without going
# farther from the data. A corner of the curve is a popular choice of the weight where the noise is unknown. This one
# has none: the weight with the lowest error against the true mesh does not stand out on it.
laplacian = cotangent_laplacian(noisy)
smoothness, distance = [], []
weights = 10.0 ** np.linspace(-2, 2, 17)
results = {}
for weight in weights:
    result = cn.denoise(noisy, method="laplacian", weights="cotan", scheme="implicit", step=1 / weight, iterations=1)
    smoothness.append(float((result.vertices * (laplacian.stiffness @ result.vertices)).sum()))
    distance.append(float((laplacian.mass[:, None] * (result.vertices - noisy.vertices) ** 2).sum()))
    results[weight] = cn.compare(result, clean).normal_error_deg
best = min(results, key=results.get)
figure, axis = plt.subplots(figsize=(5, 3.4), layout="constrained")
axis.loglog(distance, smoothness, "o-")
place = list(weights).index(best)
axis.loglog(distance[place], smoothness[place], "s", ms=9, label=f"least error to the truth, α = {best:.2g}")
axis.set(xlabel="distance from the measurement", ylabel="Dirichlet energy")
axis.legend()

# %%
# The order of the derivative decides what counts as smooth. The *membrane* energy :math:`\int|\nabla x|^2` wants
# little area and leads to :math:`\Delta x = 0`; the *thin plate* :math:`\int |\Delta x|^2` wants little bending,
# :math:`\Delta^2 x = 0`; the third order wants curvature to vary little. Replace a disk of a surface by each of these
# minima (Botsch and Kobbelt 2004): a membrane meets its boundary at an angle, a plate continues the tangents, the
# third continues the curvature.
ball = fields.sphere(radius=0.8)
smooth = tessellate(ball, extent_of(ball, rng=rng), faces=5000, sharp=False, tessellation="even", rng=rng)
top = smooth.vertices @ np.array([0.4, 0.5, 0.77]) / np.linalg.norm([0.4, 0.5, 0.77])
region = top > 0.45
show(
    [cn.denoise(smooth, method="fairing", mask=region, order=order) for order in (1, 2, 3)],
    ["membrane", "thin plate", "minimum variation"],
)

# %%
# A square penalises one large step more than many small ones with the same sum, so quadratic energies spread every
# edge over its neighbourhood. This is why the results below, from the same noisy part, differ as they do: the first
# minimises squares of first derivatives, the second *absolute values* of differences between normals. Example 7
# continues from here.
show(
    [
        noisy,
        cn.denoise(noisy, method="laplacian", weights="cotan", scheme="implicit", step=1 / best, iterations=1),
        cn.denoise(noisy, method="tv-normal"),
    ],
    ["noisy", "squares", "absolute values of the normals' differences"],
)
