"""Measure denoised partitions beside VTK's SurfaceNets: python -m benchmarks.accuracy.regions --python PEERS/bin/python

Volumes of labels are sampled from partitions whose walls are known. This package meshes them by surface nets and
denoises the walls; vtkSurfaceNets3D, run by the interpreter given, meshes and smooths them at its defaults. Of each:
the mean angle to the true walls by area, and the RMS distance of the vertices of junction curves to these, in voxels.
"""

import argparse
import subprocess
import sys
import tempfile
from collections.abc import Sequence
from pathlib import Path

import numpy as np

import cascadenorm as cn
from cascadenorm.data_gen.meshing.partitions import LabelledMesh, Partition, label_nets
from cascadenorm.mesh import Mesh, Vectors, unit

VOXEL, HALF = 0.05, 1.4
TURN = np.linalg.qr(np.random.default_rng(0).normal(size=(3, 3)))[0]
VTK = """
import sys, numpy, vtk
from vtk.util.numpy_support import numpy_to_vtk, vtk_to_numpy
labels = numpy.load(sys.argv[1])
image = vtk.vtkImageData()
image.SetDimensions(*labels.shape)
image.GetPointData().SetScalars(numpy_to_vtk(labels.ravel(order="F").astype(numpy.int16), deep=True))
nets = vtk.vtkSurfaceNets3D()
nets.SetInputData(image)
for number, label in enumerate(range(1, labels.max() + 1)):
    nets.SetValue(number, label)
nets.SetBackgroundLabel(0)
nets.SetOutputMeshTypeToTriangles()
nets.Update()
found = nets.GetOutput()
faces = vtk_to_numpy(found.GetPolys().GetConnectivityArray()).reshape(-1, 3)
numpy.savez(sys.argv[2], vertices=vtk_to_numpy(found.GetPoints().GetData()), faces=faces,
            labels=vtk_to_numpy(found.GetCellData().GetArray("BoundaryLabels")).astype(int))
"""


def ball(points: Vectors) -> np.ndarray:
    """Distance to a ball of radius 0.8."""
    return np.linalg.norm(points, axis=1) - 0.8


def cube(points: Vectors) -> np.ndarray:
    """Distance to a cube of half side 0.75, in the greatest norm."""
    return np.abs(points).max(axis=1) - 0.75


def cells(count: int, seed: int) -> Partition:
    """Voronoi cells of random sites in the cube."""
    sites = np.random.default_rng(seed).uniform(-0.7, 0.7, (count, 3))
    return Partition(cube, lambda points: np.square(points[:, None] - sites).sum(axis=2))


PARTITIONS = {
    "two half-balls": Partition(ball, lambda points: points[:, 2:] * (1, -1)),
    "a sphere in a ball": Partition(ball, lambda p: (np.linalg.norm(p - (0.4, 0, 0), axis=1) - 0.5)[:, None] * (1, -1)),
    "Voronoi cells, 4 in a box": cells(4, 1),
    "Voronoi cells, 12 in a box": cells(12, 6),
}


def main(arguments: Sequence[str] | None = None) -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--python", default=sys.executable, help="an interpreter that has vtk")
    chosen = parser.parse_args(arguments)
    print("| angle to walls, degrees (junction curves, voxels) | surface nets | auto | VTK SurfaceNets |")
    print("| --- | ---: | ---: | ---: |")
    for name, partition in PARTITIONS.items():
        axis = np.arange(-HALF, HALF + 0.5 * VOXEL, VOXEL)
        nodes = np.stack(np.meshgrid(axis, axis, axis, indexing="ij"), axis=-1).reshape(-1, 3)
        labels = partition.labels(nodes @ TURN.T).reshape((len(axis),) * 3)
        nets = label_nets(labels)
        ours = LabelledMesh(nets.mesh.moved(cn.denoise(nets.mesh).vertices), nets.labels)
        every = (nets, ours, _by_vtk(labels, chosen.python))
        print(f"| {name} | " + " | ".join(_figures(walls, partition) for walls in every) + " |", flush=True)


def _by_vtk(labels: np.ndarray, python: str) -> LabelledMesh:
    with tempfile.TemporaryDirectory() as folder:
        given, made = Path(folder) / "labels.npy", Path(folder) / "walls.npz"
        np.save(given, labels)
        subprocess.run([python, "-c", VTK, given, made], check=True)
        found = np.load(made)
        return LabelledMesh(Mesh(found["vertices"], found["faces"]), found["labels"])


def _figures(walls: LabelledMesh, partition: Partition) -> str:
    """Measure walls in units of voxels; a normal counts in either direction, since labels have no order."""
    placed = Mesh((walls.mesh.vertices * VOXEL - HALF) @ TURN.T, walls.mesh.faces)
    true = partition.normals(placed.centroids, walls.labels)
    angles = np.degrees(np.arccos(np.clip(np.abs((true * unit(placed.area_vectors)).sum(axis=1)), 0, 1)))
    sets = LabelledMesh(placed, walls.labels).vertex_sets(partition.regions(np.zeros((1, 3))).shape[1] + 1)
    on = sets.sum(axis=1) == 3
    away = np.linalg.norm(partition.nearest(placed.vertices[on], sets[on]) - placed.vertices[on], axis=1) / VOXEL
    near = away < 3  # three regions may be within a cell though they meet elsewhere
    return f"{np.average(angles, weights=placed.areas):.1f} ({np.sqrt(np.mean(away[near] ** 2)):.2f})"


if __name__ == "__main__":
    main()
