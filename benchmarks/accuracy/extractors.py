"""Measure methods on binary masks that other programs mesh.

    python -m benchmarks.accuracy.extractors [--shapes 8] [--text FILE]

Shapes are drawn from a seed that no training has and labelled on a lattice of --voxels along their longest side. VTK
(extra `pyvista`) meshes the mask in several ways; each mesh is denoised by each method. The table of mean angles to the
true surface is printed, and replaces what stands between the markers of --text.
"""

import argparse
from collections.abc import Callable, Sequence
from functools import partial
from pathlib import Path

import numpy as np
import pyvista
from numpy.typing import NDArray
from vtkmodules.vtkFiltersCore import vtkSurfaceNets3D
from vtkmodules.vtkFiltersGeneral import vtkDiscreteFlyingEdges3D

import cascadenorm as cn
from benchmarks.accuracy.results import between_markers
from cascadenorm.data_gen.families import FAMILIES
from cascadenorm.data_gen.meshing.lattice import grid
from cascadenorm.data_gen.meshing.surface import UnfitShapeError, extent_of
from cascadenorm.data_gen.scanning.measured import Measured, beneath
from cascadenorm.data_gen.shapes.fields import Field
from cascadenorm.execution.process_map import side_by_side
from cascadenorm.mesh import Mesh, angles_between, thread_count

BEGIN, END = "<!-- extractors: written by benchmarks/accuracy/extractors.py -->", "<!-- end of extractors -->"
SHAPES = ("statue", "bracket", "bust", "turned", "creature", "assembly", "wheel", "rock")
METHODS = ("auto", "guided-normal", "bilateral-normal", "taubin")
SEED = 991

Mask = NDArray[np.bool_]
Extractor = Callable[[Mask], pyvista.PolyData]


def points_of(mask: Mask) -> pyvista.ImageData:
    """Return the mask as labels of points."""
    image = pyvista.ImageData(dimensions=mask.shape)
    image.point_data.set_array(mask.astype(np.uint8).ravel(order="F"), "label")
    image.set_active_scalars("label")
    return image


def flying_edges(mask: Mask) -> pyvista.PolyData:
    """Mesh by discrete marching cubes."""
    return _run(vtkDiscreteFlyingEdges3D(), mask)


def surface_nets(mask: Mask, *, smoothed: bool) -> pyvista.PolyData:
    """Mesh by surface nets, and let them smooth the mesh within its constraints, or not."""
    nets = vtkSurfaceNets3D()
    nets.SetSmoothing(smoothed)
    return _run(nets, mask)


def voxel_faces(mask: Mask) -> pyvista.PolyData:
    """Take the faces between voxels inside and outside."""
    image = pyvista.ImageData(dimensions=np.array(mask.shape) + 1, origin=(-0.5, -0.5, -0.5))
    image.cell_data["label"] = mask.astype(np.uint8).ravel(order="F")
    return image.threshold(0.5).extract_surface(algorithm="dataset_surface")


def _run(extractor: vtkSurfaceNets3D | vtkDiscreteFlyingEdges3D, mask: Mask) -> pyvista.PolyData:
    extractor.SetInputData(points_of(mask))
    extractor.SetValue(0, 1)
    extractor.Update()
    return pyvista.wrap(extractor.GetOutput())


EXTRACTORS: dict[str, Extractor] = {
    "discrete marching cubes": flying_edges,
    "… half of the faces, quadrics": lambda mask: flying_edges(mask).decimate(0.5),
    "… half of the faces, decimate_pro": lambda mask: flying_edges(mask).decimate_pro(0.5, preserve_topology=True),
    "… smoothed by Laplacian, 5 iterations": lambda mask: flying_edges(mask).smooth(n_iter=5, relaxation_factor=0.1),
    "surface nets, not smoothed": partial(surface_nets, smoothed=False),
    "surface nets, smoothed": partial(surface_nets, smoothed=True),
    "faces of voxels": voxel_faces,
}


def main(arguments: Sequence[str] | None = None) -> None:
    """Mesh, denoise and measure, and print the means as a table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--shapes", type=int, default=8)
    parser.add_argument("--voxels", type=int, default=60)
    parser.add_argument("--text", type=Path)
    chosen = parser.parse_args(arguments)
    with side_by_side(thread_count()) as each:
        figures = np.array(list(each(partial(angles_of_shape, voxels=chosen.voxels), range(chosen.shapes))))
    lines = [f"| mean angle, degrees | mesh | {' | '.join(METHODS)} |", "| --- |" + " ---: |" * (1 + len(METHODS))]
    for name, means in zip(EXTRACTORS, figures.mean(axis=0), strict=True):
        lines.append(f"| {name} | " + " | ".join(f"{angle:.1f}" for angle in means) + " |")
    table = "\n".join(lines)
    print(table)
    if chosen.text:
        text = chosen.text.read_text(encoding="utf-8")
        chosen.text.write_text(between_markers(text, table, BEGIN, END), encoding="utf-8")


def angles_of_shape(number: int, *, voxels: int) -> list[list[float]]:
    """Label a shape and mesh it by each extractor: the angles of the mesh, and of what each method makes of it."""
    rng = np.random.default_rng([SEED, number])
    while True:
        try:
            field = FAMILIES[SHAPES[number % len(SHAPES)]].shape(0.05, rng)
            extent = extent_of(field, rng=rng)
        except UnfitShapeError:
            continue
        break
    size = float(np.max(extent.upper - extent.lower) / voxels)
    nodes = grid(0.5 * (extent.upper - extent.lower) + 3 * size, np.full(3, size)) + extent.middle
    mask = (field(nodes.reshape(-1, 3)) < 0).reshape(nodes.shape[:3])
    rows = []
    for extract in EXTRACTORS.values():
        found = measured(field, extract(mask).triangulate().clean(), nodes[0, 0, 0], size)
        noisy = found.noisy
        meshes = [noisy, *(cn.denoise(noisy, method=name) for name in METHODS)]
        rows.append([angle(mesh, found.normals) for mesh in meshes])
    return rows


def measured(field: Field, made: pyvista.PolyData, origin: NDArray[np.float64], size: float) -> Measured:
    """Place a mesh that is given in voxels over its shape, its normals outward."""
    faces = made.faces.reshape(-1, 4)[:, 1:]
    noisy = Mesh(origin + size * np.asarray(made.points, np.float64), faces)
    found = beneath(field, noisy, cell=size)
    if np.einsum("ij,ij", noisy.area_vectors, found.normals) < 0:
        found = beneath(field, Mesh(noisy.vertices, faces[:, ::-1]), cell=size)
    return found


def angle(mesh: Mesh, normals: NDArray[np.float64]) -> float:
    """Mean angle by area to the true normals that are known, in degrees."""
    known = normals.any(axis=1) & mesh.face_normals.any(axis=1)
    angles = angles_between(mesh.face_normals[known], normals[known])
    return float(np.degrees(np.average(angles, weights=mesh.areas[known])))


if __name__ == "__main__":
    main()
