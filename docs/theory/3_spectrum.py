"""
3. The spectrum
===============

A signal on the line is a sum of waves, and a filter multiplies each wave by a factor. A surface has waves as well:
the eigenvectors of its Laplacian (Taubin 1995; Vallet and Lévy 2008), :math:`S \\varphi_i = \\lambda_i M \\varphi_i`,
where a small :math:`\\lambda_i` means a long wave.
"""

# %%
# The first of these *manifold harmonics* on a head, as colours: each has more and shorter waves than the one before.
import matplotlib.pyplot as plt
import numpy as np

import cascadenorm as cn
from cascadenorm.data_gen.meshing.surface import extent_of
from cascadenorm.data_gen.meshing.tessellation import tessellate
from cascadenorm.data_gen.noise.noise import displacements
from cascadenorm.data_gen.shapes import organic
from cascadenorm.render import HeatMap, render

rng = np.random.default_rng(4)
bust = organic.bust(0.05, rng)
clean = tessellate(bust, extent_of(bust, rng=rng), faces=2500, sharp=False, tessellation="even", rng=rng)
noisy = clean.moved(clean.vertices + displacements(clean, "gaussian", level=0.2, rng=rng))


def show(pictures, titles):
    _, axes = plt.subplots(1, len(pictures), figsize=(9, 9 / len(pictures)), layout="constrained")
    for axis, picture, title in zip(axes, pictures, titles, strict=True):
        axis.imshow(picture)
        axis.set_title(title, fontsize=10)
        axis.axis("off")


waves = cn.manifold_harmonics(noisy, 600)
chosen = (1, 4, 20, 100)
largest = [float(np.abs(waves.vectors[:, number]).max()) for number in chosen]
show(
    [
        render(clean, size=(320, 320), values=HeatMap(waves.vectors[:, number], "vertex", (-most, most), True))
        for number, most in zip(chosen, largest, strict=True)
    ],
    [f"harmonic {number}" for number in chosen],
)


# %%
# The coordinates of the vertices are signals on the surface, and so is the noise. The shape lies in the low
# frequencies and falls off quickly; white noise has about the same energy in all of them. The curves cross:
# above that frequency there is more noise than shape.
def energies(values):
    return (waves.coefficients(values) ** 2).sum(axis=1)


def averaged(values):
    return np.convolve(values, np.full(25, 1 / 25), mode="valid")


where = averaged(np.arange(600))
figure, axis = plt.subplots(figsize=(6, 3.4), layout="constrained")
axis.loglog(where, averaged(energies(clean.vertices)), label="shape")
axis.loglog(where, averaged(energies(noisy.vertices - clean.vertices)), label="noise")
axis.set(xlabel="number of the harmonic", ylabel="energy")
axis.legend()

# %%
# Dropping all harmonics beyond the k-th is the ideal low-pass. Few harmonics lose the shape, many keep the noise.
counts = (30, 100, 200, 600)
lowpass = [cn.denoise(noisy, method="spectral", harmonics=count) for count in counts]
error = [cn.compare(mesh, clean).normal_error_deg for mesh in lowpass]
show(
    [render(mesh, size=(320, 320)) for mesh in lowpass],
    [f"{count} harmonics, {angle:.1f}°" for count, angle in zip(counts, error, strict=True)],
)

# %%
# Eigenvectors are costly, and not needed: every filter that is a polynomial or a rational function of the Laplacian
# multiplies harmonic :math:`\lambda_i` by the same function of :math:`\lambda_i`, without computing them.
# An explicit step of diffusion multiplies by :math:`1 - t\lambda`, an implicit one by :math:`1/(1 + t\lambda)`,
# Taubin's pair by :math:`(1 - \lambda k)(1 - \mu k)`. Measured on this mesh, as the ratio of the coefficients after
# and before:
edge = noisy.mean_edge_length
before = waves.coefficients(noisy.vertices)
scaled = waves.values * edge**2
figure, axis = plt.subplots(figsize=(6, 3.4), layout="constrained")
for step in (0.5, 2.0, 8.0):
    after = cn.denoise(noisy, method="laplacian", weights="cotan", scheme="implicit", step=step, iterations=1)
    ratio = (waves.coefficients(after.vertices) * before).sum(axis=1) / (before**2).sum(axis=1)
    (line,) = axis.plot(scaled[1:], ratio[1:], ".", ms=2)
    axis.plot(scaled[1:], 1 / (1 + step * scaled[1:]), color=line.get_color(), label=f"1 / (1 + {step:g} λ)")
axis.set(xlabel="eigenvalue λ, 1 / squared mean edge length", ylabel="factor", ylim=(0, 1.05))
axis.legend()

# %%
# The spectrum shows the limit of every linear low-pass filter: an edge has all frequencies, so removing the high ones
# of the noise also removes those of the edge. The methods of the later examples are non-linear.
