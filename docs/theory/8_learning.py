"""
8. Learning
===========

Every filter so far has a parameter that says what an edge is, and one value of it for the whole mesh. Cascaded normal
regression (Wang, Liu and Tong 2016) applies many filters at once and *learns* how to combine their answers at each
face.
"""

# %%
# A bank of bilateral filters with several spreads and numbers of passes gives each face several filtered normals.
# Where the surface is flat they agree; near an edge they differ, depending on where the face lies. How good is each
# filter alone, and how good would they be if each face used the best one?
import matplotlib.pyplot as plt
import numpy as np
from scipy.cluster.vq import kmeans2

import cascadenorm as cn
from cascadenorm.baselines.bilateral_normal import bilateral_normals
from cascadenorm.data_gen.meshing.surface import extent_of
from cascadenorm.data_gen.meshing.tessellation import tessellate
from cascadenorm.data_gen.noise.noise import displacements
from cascadenorm.data_gen.shapes import fields
from cascadenorm.render import HeatMap, render

SPREADS = (0.2, 0.35, 0.5, 0.8, np.inf)
FILTERS = [(passes, spread) for passes in (2, 8) for spread in SPREADS]
GROUPS = 40


def part(seed, level):
    rng = np.random.default_rng(seed)
    shape = fields.difference(
        fields.union(fields.box([0.7, 0.4, 0.6]), fields.cylinder(radius=0.35, half_height=0.8)),
        fields.cylinder(radius=0.2, half_height=1.0),
    )
    clean = tessellate(shape, extent_of(shape, rng=rng), faces=6000, sharp=True, tessellation="even", rng=rng)
    return clean.moved(clean.vertices + displacements(clean, "gaussian", level=level, rng=rng)), clean


def bank(mesh):
    """The filtered normals of each face, (m, k, 3)."""
    return np.stack(
        [bilateral_normals(mesh, sigma_s=1.0, sigma_r=spread, iterations=passes) for passes, spread in FILTERS], axis=1
    )


def angles(normals, truth):
    return np.degrees(np.arccos(np.clip(np.einsum("ij,ij->i", normals, truth), -1, 1)))


noisy, clean = part(1, 0.25)
filtered = bank(noisy)
wanted = clean.face_normals
each = np.stack([angles(filtered[:, k], wanted) for k in range(len(FILTERS))])
print("mean angle of each filter:", each.mean(axis=1).round(1))
print("if each face took its best one:", each.min(axis=0).mean().round(1))

# %%
# The last line motivates learning: no single spread is best everywhere. Which one is best depends on the face.
best = each.argmin(axis=0) % len(SPREADS)
figure, axes = plt.subplots(1, 2, figsize=(8, 4), layout="constrained")
axes[0].imshow(render(noisy, size=(500, 500)))
axes[0].set_title("noisy", fontsize=10)
axes[1].imshow(render(clean, size=(500, 500), values=HeatMap(best.astype(float), "face", (0, len(SPREADS) - 1), False)))
axes[1].set_title("which spread is best: narrow dark, wide bright", fontsize=10)
for axis in axes:
    axis.axis("off")

# %%
# A face must be described so that the pose of the mesh does not matter. The angles between its own filtered normals
# do that: they are the *descriptor*. From it a regression gives a coefficient for each filtered normal, and the
# weighted sum is the new normal. Here the regression is the simplest that there is: faces with similar descriptors
# are grouped by k-means, and each group has one set of coefficients, by least squares on the training mesh.
upper = np.triu_indices(len(FILTERS), 1)


def descriptors(stack):
    products = np.einsum("mik,mjk->mij", stack, stack)[:, upper[0], upper[1]]
    return np.log(1 - products + 1e-4)


def fitted(stack, truth, labels, groups):
    coefficients = np.zeros((groups, stack.shape[1]))
    for group in range(groups):
        rows = stack[labels == group]
        system = np.einsum("mik,mjk->ij", rows, rows) + 1e-3 * len(rows) * np.eye(stack.shape[1])
        coefficients[group] = np.linalg.solve(system, np.einsum("mik,mk->i", rows, truth[labels == group]))
    return coefficients


def applied(stack, labels, coefficients):
    sums = np.einsum("mi,mik->mk", coefficients[labels], stack)
    return sums / np.linalg.norm(sums, axis=1, keepdims=True)


scale = descriptors(filtered).std(axis=0)
centers, labels = kmeans2(descriptors(filtered) / scale, GROUPS, seed=0, minit="++")
coefficients = fitted(filtered, wanted, labels, GROUPS)

# %%
# On a mesh with other noise, which the regression has not seen, it does better than the best of its own filters:
test_noisy, test_clean = part(2, 0.25)
stack = bank(test_noisy)
nearest = np.linalg.norm((descriptors(stack) / scale)[:, None] - centers, axis=2).argmin(axis=1)
learned = applied(stack, nearest, coefficients)
single = [angles(stack[:, k], test_clean.face_normals).mean() for k in range(len(FILTERS))]
figure, axis = plt.subplots(figsize=(8, 3.4), layout="constrained")
axis.bar([f"{passes} × {spread:g}" for passes, spread in FILTERS], single, color="grey")
axis.bar(["regression"], [angles(learned, test_clean.face_normals).mean()])
axis.tick_params(axis="x", rotation=30)
axis.set(xlabel="passes × σ_r of a single filter", ylabel="mean angle to the true normals, degrees")

# %%
# The method of the package extends this: wider filters, networks in place of least squares, generated
# shapes and many kinds of error for training, and a *cascade*, in which the vertices follow the normals and the next
# stage starts from the better mesh. The error falls from stage to stage.
model = cn.Denoiser.shipped("auto").model.vertex

stages = [test_noisy, *model.steps(test_noisy)]
figure, axes = plt.subplots(1, 4, figsize=(9, 2.7), layout="constrained")
for number, (axis, mesh) in enumerate(zip(axes, stages, strict=True)):
    axis.imshow(render(mesh, size=(360, 360)))
    axis.set_title(f"stage {number}, {cn.compare(mesh, test_clean).normal_error_deg:.1f}°", fontsize=10)
    axis.axis("off")
