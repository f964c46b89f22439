"""Filters of other libraries: PEERS/bin/python -m benchmarks.accuracy.peer_filters IN OUT NAME ...

IN holds vertices and faces (NumPy .npz). For each setting of the filters named, the folder OUT receives
NAME-NUMBER.npz, the number from 0; the first is the filter at its defaults. Nothing of this project is imported here.
"""

import sys
from pathlib import Path

import numpy as np


def vtk_poly_data(vertices, faces):
    """Return a vtkPolyData."""
    import vtk
    from vtk.util.numpy_support import numpy_to_vtk, numpy_to_vtkIdTypeArray

    mesh, points, cells = vtk.vtkPolyData(), vtk.vtkPoints(), vtk.vtkCellArray()
    points.SetData(numpy_to_vtk(np.ascontiguousarray(vertices, np.float64), deep=True))
    offsets = np.arange(0, 3 * len(faces) + 1, 3, dtype=np.int64)
    corners = np.ascontiguousarray(faces.ravel(), np.int64)
    cells.SetData(numpy_to_vtkIdTypeArray(offsets, deep=True), numpy_to_vtkIdTypeArray(corners, deep=True))
    mesh.SetPoints(points)
    mesh.SetPolys(cells)
    return mesh


def vtk_vertices(smoother):
    """Return the vertices of the output of a VTK filter."""
    from vtk.util.numpy_support import vtk_to_numpy

    smoother.Update()
    return vtk_to_numpy(smoother.GetOutput().GetPoints().GetData())


def windowed_sinc(vertices, faces, **settings):
    """vtkWindowedSincPolyDataFilter."""
    import vtk

    smoother = vtk.vtkWindowedSincPolyDataFilter()
    smoother.SetInputData(vtk_poly_data(vertices, faces))
    if settings:
        smoother.SetPassBand(settings["passband"])
        smoother.SetNumberOfIterations(settings["iterations"])
        smoother.NormalizeCoordinatesOn()
    return vtk_vertices(smoother), faces


def surface_nets(vertices, faces, *, iterations=16, distance=1.0):
    """vtkConstrainedSmoothingFilter as vtkSurfaceNets3D sets it, constrained to a mean edge length for a voxel."""
    import vtk

    smoother = vtk.vtkConstrainedSmoothingFilter()
    smoother.SetInputData(vtk_poly_data(vertices, faces))
    sides = vertices[faces] - vertices[np.roll(faces, 1, axis=1)]
    smoother.SetConstraintStrategyToConstraintDistance()
    smoother.SetConstraintDistance(distance * float(np.linalg.norm(sides, axis=2).mean()))
    smoother.SetNumberOfIterations(iterations)
    smoother.SetRelaxationFactor(0.5)
    return vtk_vertices(smoother), faces


def meshlab(filter_name):
    """Return a filter of MeshLab by its name in PyMeshLab."""

    def apply(vertices, faces, **settings):
        import pymeshlab

        meshes = pymeshlab.MeshSet(verbose=False)
        meshes.add_mesh(pymeshlab.Mesh(np.asarray(vertices, np.float64), np.asarray(faces, np.int32)))
        meshes.apply_filter(filter_name, **settings)
        return meshes.current_mesh().vertex_matrix(), meshes.current_mesh().face_matrix()

    return apply


def humphrey(vertices, faces, **settings):
    """Smooth by trimesh.smoothing.filter_humphrey."""
    import trimesh

    mesh = trimesh.Trimesh(vertices, faces, process=False)
    return trimesh.smoothing.filter_humphrey(mesh, **settings).vertices, faces


def open3d_taubin(vertices, faces, **settings):
    """Smooth by open3d's TriangleMesh.filter_smooth_taubin."""
    import open3d

    mesh = open3d.geometry.TriangleMesh(
        open3d.utility.Vector3dVector(vertices), open3d.utility.Vector3iVector(np.asarray(faces, np.int32))
    )
    return np.asarray(mesh.filter_smooth_taubin(**settings).vertices), faces


def meshlib(vertices, faces, **settings):
    """Denoise by MeshLib's meshDenoiseViaNormals."""
    from meshlib import mrmeshnumpy, mrmeshpy

    mesh = mrmeshnumpy.meshFromFacesVerts(np.asarray(faces, np.int32), vertices)
    chosen = mrmeshpy.DenoiseViaNormalsSettings()
    for name, value in settings.items():
        setattr(chosen, name, value)
    mrmeshpy.meshDenoiseViaNormals(mesh, chosen)
    return mrmeshnumpy.getNumpyVerts(mesh), mrmeshnumpy.getNumpyFaces(mesh.topology)


FILTERS = {
    "VTK windowed sinc": (
        windowed_sinc,
        [{}, *({"passband": p, "iterations": 50} for p in (0.3, 0.1, 0.03, 0.01, 0.003))],
    ),
    "VTK SurfaceNets": (
        surface_nets,
        [{}, *({"iterations": n, "distance": d} for n, d in ((4, 1.0), (64, 1.0), (64, 2.0), (64, 0.5)))],
    ),
    "MeshLab Taubin": (
        meshlab("apply_coord_taubin_smoothing"),
        [{}, *({"stepsmoothnum": n} for n in (3, 30, 100))],
    ),
    "MeshLab Laplacian": (
        meshlab("apply_coord_laplacian_smoothing"),
        [{}, *({"stepsmoothnum": n} for n in (1, 6, 12))],
    ),
    "MeshLab two-step": (
        meshlab("apply_coord_two_steps_smoothing"),
        [{}, *({"stepsmoothnum": n, "normalthr": t} for n, t in ((3, 30.0), (10, 30.0), (10, 60.0)))],
    ),
    "trimesh Humphrey": (
        humphrey,
        [{}, *({"beta": b, "iterations": n} for b, n in ((0.5, 30), (0.2, 10), (0.2, 30)))],
    ),
    "Open3D Taubin": (
        open3d_taubin,
        [{}, *({"number_of_iterations": n} for n in (10, 30, 100))],
    ),
    "MeshLib": (meshlib, [{}, *({"beta": b, "gamma": g} for b, g in ((0.003, 5.0), (0.03, 5.0), (0.01, 10.0)))]),
}
"""Function and settings of each filter; the first settings are its defaults."""


def main():
    """Apply each setting of the named filters. Failures are reported and skipped."""
    given = np.load(sys.argv[1])
    for name in sys.argv[3:]:
        function, every = FILTERS[name]
        for number, settings in enumerate(every):
            try:
                vertices, faces = function(given["vertices"].copy(), given["faces"].copy(), **settings)
            except Exception as error:  # whatever another library raises
                print(f"{name} {settings}: {type(error).__name__}: {error}", file=sys.stderr)
                continue
            np.savez(Path(sys.argv[2]) / f"{name}-{number}.npz", vertices=vertices, faces=faces)


if __name__ == "__main__":
    main()
