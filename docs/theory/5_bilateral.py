"""
5. The bilateral idea
=====================

A mean blurs an edge because it takes values from both of its sides. The bilateral filter (Tomasi and Manduchi 1998)
asks each neighbour two questions: are you near, and are you *like me*?

.. math:: y_i = \\frac{\\sum_j e^{-|p_i - p_j|^2 / 2\\sigma_s^2}\\; e^{-|x_i - x_j|^2 / 2\\sigma_r^2}\\; x_j}
                      {\\sum_j e^{-|p_i - p_j|^2 / 2\\sigma_s^2}\\; e^{-|x_i - x_j|^2 / 2\\sigma_r^2}} .
"""

# %%
# On a line first: a step with noise. The Gaussian mean blurs the step, the bilateral mean does not.
import matplotlib.pyplot as plt
import numpy as np

import cascadenorm as cn
from cascadenorm.data_gen.meshing.surface import extent_of
from cascadenorm.data_gen.meshing.tessellation import tessellate
from cascadenorm.data_gen.noise.noise import displacements
from cascadenorm.data_gen.shapes import fields
from cascadenorm.render import render

rng = np.random.default_rng(1)
places = np.arange(200.0)
signal = (places > 100) + rng.normal(scale=0.12, size=200)


def bilateral(values, sigma_s, sigma_r):
    near = np.exp(-((places[:, None] - places) ** 2) / (2 * sigma_s**2))
    alike = np.exp(-((values[:, None] - values) ** 2) / (2 * sigma_r**2))
    return (near * alike @ values) / (near * alike).sum(axis=1)


figure, axis = plt.subplots(figsize=(8, 3.2), layout="constrained")
axis.plot(places, signal, ".", color="grey", label="measured")
axis.plot(places, bilateral(signal, 8, np.inf), label="mean: σ_r = ∞")
axis.plot(places, bilateral(signal, 8, 0.4), label="bilateral: σ_r = 0.4")
axis.legend()

# %%
# On a mesh the positions are no signal over a domain; they *are* the domain. Fleishman, Drori and Cohen-Or (2003)
# use the height of the neighbours above the tangent plane of a vertex as the signal. Jones, Durand and Desbrun
# (2003) use the projections of a vertex onto the planes of near faces. Zheng et al. (2011) filter the *normals* of the
# faces, whose jump at an edge is large and clear, and let the vertices follow:
box = fields.box([0.7, 0.7, 0.7])
clean = tessellate(box, extent_of(box, rng=rng), faces=5000, sharp=True, tessellation="even", rng=rng)
noisy = clean.moved(clean.vertices + displacements(clean, "gaussian", level=0.2, rng=rng))


def show(meshes, titles):
    _, axes = plt.subplots(1, len(meshes), figsize=(9, 9 / len(meshes)), layout="constrained")
    for axis, mesh, title in zip(axes, meshes, titles, strict=True):
        axis.imshow(render(mesh, size=(400, 400)))
        axis.set_title(f"{title}, {cn.compare(mesh, clean).normal_error_deg:.1f}°", fontsize=10)
        axis.axis("off")


names = ("bilateral", "non-iterative-bilateral", "bilateral-normal")
show([cn.denoise(noisy, method=name) for name in names], names)

# %%
# The range spread is the threshold between noise and edge. If it is too narrow, noise counts as edges and stays. If
# it is too wide, edges count as noise. The best value grows with the noise, and under heavy noise no
# value separates the two: they overlap.
spreads = (0.15, 0.25, 0.35, 0.45, 0.6, 0.8, 1.2)
figure, axis = plt.subplots(figsize=(6, 3.4), layout="constrained")
for level in (0.1, 0.2, 0.35):
    rough = clean.moved(clean.vertices + displacements(clean, "gaussian", level=level, rng=rng))
    results = [cn.denoise(rough, method="bilateral-normal", sigma_r=spread) for spread in spreads]
    axis.plot(spreads, [cn.compare(one, clean).normal_error_deg for one in results], "o-", label=f"level {level}")
axis.set(xlabel="σ_r, chord between normals", ylabel="mean angle to the true normals, degrees", ylim=(0, None))
axis.legend()

# %%
# A *joint* or *guided* filter takes the range weight from something less noisy than the normals themselves,
# such as the mean normal of the flattest patch nearby (Zhang et al. 2015). A *rolling guidance* filter takes it from
# its previous result, which makes it a filter of scale: features narrower than a width are removed, noise or not.
rough = clean.moved(clean.vertices + displacements(clean, "gaussian", level=0.35, rng=rng))
names = ("bilateral-normal", "guided-normal", "auto")
show([cn.denoise(rough, method=name) for name in names], names)
