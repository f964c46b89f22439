"""Measure methods on generated shapes, with seeds that are not used for training.

    python -m benchmarks.accuracy.generated levels [--shapes 8] [--record]
    python -m benchmarks.accuracy.generated extractors [--shapes 8] [--voxels 60] [--record]
    python -m benchmarks.accuracy.generated elongated [--shapes 12] [--record]
    python -m benchmarks.accuracy.generated decimated [--shapes 8] [--record]
    python -m benchmarks.accuracy.generated reliefs [--shapes 8] [--record]

`levels` meshes each shape with real kinds of error from weak to strong: from grey volumes with more and more grain,
from points with larger and larger errors, and with error that is correlated over several edges; and simulates laser
scans of other shapes with larger and larger errors. `extractors` labels
each shape on a lattice and meshes the mask by VTK in several ways (extra `pyvista`). `elongated` adds noise along the
normals to parametric surfaces over grids, most with elongated triangles (extra `pyvista`). `decimated` decimates
measured surfaces and clean shapes by VTK (extra `pyvista`). `reliefs` meshes shapes with fine relief by marching cubes,
without error. The tables have the mean angle to the true surface by area,
in degrees; all are shown in benchmarks/accuracy.md.
"""

import argparse
from collections.abc import Callable, Sequence
from functools import partial
from typing import Any, TypeVar

import numpy as np
from numpy.typing import NDArray

from benchmarks import results, running
from cascadenorm.data_gen.errors import UnfitShapeError
from cascadenorm.data_gen.families import SHAPE_FAMILIES, ShapeFamily
from cascadenorm.data_gen.meshing.lattice import grid
from cascadenorm.data_gen.meshing.surface import Extent, extent_of
from cascadenorm.data_gen.noise.noise import displacements
from cascadenorm.data_gen.noise.sensor import laser_displacements
from cascadenorm.data_gen.scanning.isosurfaces import EDGE, MESHERS, level_surface, onto_level
from cascadenorm.data_gen.scanning.measured import Measured, beneath
from cascadenorm.data_gen.scanning.points import reconstruction
from cascadenorm.data_gen.scanning.volumes import tomogram
from cascadenorm.data_gen.shapes import patterns
from cascadenorm.data_gen.shapes.fields import DistanceField, pushed_out
from cascadenorm.execution.process_map import parallel_map
from cascadenorm.mesh import Mesh, angles_between, thread_count

SHAPES = ("statue", "bracket", "bust", "turned", "creature", "assembly", "wheel", "rock")
METHODS = ("auto", "guided-normal", "bilateral-normal", "taubin")
SEEDS = {"levels": 992, "extractors": 991, "elongated": 993, "decimated": 994, "reliefs": 995}
FACES = 10_000

TURN = 2 * np.pi

Grid = NDArray[np.float64]
Points = tuple[Grid, Grid, Grid]
Mask = NDArray[np.bool_]
Made = TypeVar("Made")
Maker = Callable[[ShapeFamily, float, np.random.Generator], Measured]


def grainy(family: ShapeFamily, share: float, rng: np.random.Generator) -> Measured:
    """Mesh a grey volume with noise whose standard deviation is a fraction of the contrast."""
    return tomogram(*drawn(family, rng), faces=FACES, level=5 * share, rng=rng)


def reconstructed(family: ShapeFamily, gaps: float, rng: np.random.Generator) -> Measured:
    """Reconstruct from points with errors along the normals, given in mean distances between points."""
    return reconstruction(*drawn(family, rng), faces=FACES, level=gaps, rng=rng)


def bumpy(family: ShapeFamily, edges: float, rng: np.random.Generator) -> Measured:
    """Displace the vertices of a clean mesh by error that is correlated over several edges."""
    clean = family.make(faces=FACES, rng=rng).clean
    noisy = clean.moved(clean.vertices + displacements(clean, "correlated", level=edges, rng=rng))
    return Measured.on_surface(noisy, clean)


def scanned(_: ShapeFamily, edges: float, rng: np.random.Generator) -> Measured:
    """Scan a shape of the family `laser` by a laser scanner with an error in mean edge lengths."""
    clean = SHAPE_FAMILIES["laser"].make(faces=FACES, rng=rng).clean
    moves = laser_displacements(clean, edges * clean.mean_edge_length, rng=rng)
    return Measured.on_surface(clean.moved(clean.vertices + moves), clean)


ERRORS: dict[str, tuple[Maker, float]] = {
    **{f"tomogram, grain of {share:.0%} of the contrast": (grainy, share) for share in (0.02, 0.05, 0.1, 0.15)},
    **{f"points off by {gaps:g} of their distance": (reconstructed, gaps) for gaps in (0.25, 0.5, 1.0, 2.0)},
    **{f"correlated error of {edges:g} edges": (bumpy, edges) for edges in (0.1, 0.2, 0.4, 0.8)},
    **{f"laser scan with an error of {edges:g} edges": (scanned, edges) for edges in (0.05, 0.1, 0.2)},
}


def flying_edges(mask: Mask) -> Any:
    """Mesh by discrete marching cubes."""
    from vtkmodules.vtkFiltersGeneral import vtkDiscreteFlyingEdges3D

    return _run(vtkDiscreteFlyingEdges3D(), mask)


def surface_nets(mask: Mask, *, smoothed: bool) -> Any:
    """Mesh by surface nets, optionally with their constrained smoothing."""
    from vtkmodules.vtkFiltersCore import vtkSurfaceNets3D

    nets = vtkSurfaceNets3D()
    nets.SetSmoothing(smoothed)
    return _run(nets, mask)


def voxel_faces(mask: Mask) -> Any:
    """Return the faces between voxels inside and outside."""
    import pyvista

    image = pyvista.ImageData(dimensions=np.array(mask.shape) + 1, origin=(-0.5, -0.5, -0.5))
    image.cell_data["label"] = mask.astype(np.uint8).ravel(order="F")
    return image.threshold(0.5).extract_surface(algorithm="dataset_surface")


def _run(extractor: Any, mask: Mask) -> Any:
    import pyvista

    image = pyvista.ImageData(dimensions=mask.shape)
    image.point_data.set_array(mask.astype(np.uint8).ravel(order="F"), "label")
    image.set_active_scalars("label")
    extractor.SetInputData(image)
    extractor.SetValue(0, 1)
    extractor.Update()
    return pyvista.wrap(extractor.GetOutput())


EXTRACTORS: dict[str, Callable[[Mask], Any]] = {
    "discrete marching cubes": flying_edges,
    "… half of the faces, quadrics": lambda mask: flying_edges(mask).decimate(0.5),
    "… half of the faces, decimate_pro": lambda mask: flying_edges(mask).decimate_pro(0.5, preserve_topology=True),
    "… smoothed by Laplacian, 5 iterations": lambda mask: flying_edges(mask).smooth(n_iter=5, relaxation_factor=0.1),
    "surface nets, not smoothed": partial(surface_nets, smoothed=False),
    "surface nets, smoothed": partial(surface_nets, smoothed=True),
    "faces of voxels": voxel_faces,
}


def vase(u: Grid, v: Grid) -> Points:
    """Return points of a surface of revolution with two waves along its axis, for parameters from 0 to 1."""
    radius = 0.5 + 0.2 * np.sin(5 * v) + 0.1 * np.cos(11 * v)
    return radius * np.cos(TURN * u), radius * np.sin(TURN * u), 2 * v


def helix(u: Grid, v: Grid) -> Points:
    """Return points of a tube around three turns of a helix."""
    arm = 1 + 0.25 * np.cos(TURN * v)
    return arm * np.cos(3 * TURN * u), arm * np.sin(3 * TURN * u), 0.25 * np.sin(TURN * v) + 2.2 * u


def wing(u: Grid, v: Grid) -> Points:
    """Return points of a tapered wing with a sharp trailing edge."""
    chord = 1 - 0.5 * v
    thickness = 0.15 * np.sin(TURN * u) * (1 + np.cos(TURN * u))
    return chord * np.cos(TURN * u), chord * thickness, 4 * v


def over_grid(surface: Callable[[Grid, Grid], Points], rows: int, columns: int) -> Any:
    """Return a parametric surface over a grid of rows × columns points."""
    import pyvista

    u, v = np.meshgrid(np.linspace(0, 1, rows), np.linspace(0, 1, columns), indexing="ij")
    return pyvista.StructuredGrid(*(x[..., None] for x in surface(u, v))).extract_surface(algorithm="dataset_surface")


def of_vtk(name: str) -> Any:
    """Return a parametric surface of VTK over a grid of 100 × 100 points."""
    import pyvista

    return getattr(pyvista, f"Parametric{name}")()


SURFACES: tuple[Callable[[], Any], ...] = (
    *(partial(of_vtk, name) for name in ("Bour", "Dini", "ConicSpiral", "Klein", "Boy", "Enneper", "SuperToroid")),
    partial(over_grid, vase, 41, 400),
    partial(over_grid, vase, 401, 60),
    partial(over_grid, helix, 100, 81),
    partial(over_grid, helix, 600, 17),
    partial(over_grid, wing, 201, 30),
)
HEIGHTS = 0.0, 0.1, 0.3
"""Standard deviations of the noise on parametric surfaces, in median heights of the triangles."""


MEASUREMENTS: dict[str, Callable[..., Measured]] = {
    "tomogram, grain of 10%": partial(tomogram, level=0.5),
    "points off by their distance": partial(reconstruction, level=1.0),
}
REMOVED = 0.5, 0.8
"""Fractions of the faces of measured surfaces that decimation removes."""
CLEAN_REMOVED = 0.9
"""The same for clean shapes."""

RELIEFS: dict[str, tuple[Callable[..., DistanceField], tuple[float, ...]]] = {
    "waves": (patterns.sines, (4.0, 6.0, 8.0, 12.0)),
    "wrinkles": (partial(patterns.noise, form="ridged"), (6.0, 12.0)),
    "grooves": (partial(patterns.stripes, wander=0.5, sharpness=1.0), (6.0, 12.0)),
    "scales": (partial(patterns.cells, kind="bumps"), (6.0, 12.0)),
    "cracks": (partial(patterns.cells, kind="cracks"), (6.0, 12.0)),
}
"""Patterns of relief, and their wavelengths in mean edge lengths."""
RELIEF_HEIGHT = 0.1
"""Height of relief in wavelengths."""


def main(arguments: Sequence[str] | None = None) -> None:
    """Make the meshes, denoise and measure them."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("kind", choices=SEEDS)
    parser.add_argument("--shapes", type=int, help="number of shapes (default: 8, or all 12 parametric surfaces)")
    parser.add_argument("--voxels", type=int, default=60, help="of masks, along the longest side of a shape")
    running.add_methods(parser, METHODS)
    parser.add_argument("--record", action="store_true", help="write the figures and their table")
    options = parser.parse_args(arguments)
    methods = running.chosen_methods(options)
    count = options.shapes or (len(SURFACES) if options.kind == "elongated" else len(SHAPES))
    makers = {"levels": of_levels, "elongated": of_elongated, "decimated": of_decimated, "reliefs": of_reliefs}
    makers["extractors"] = partial(of_extractors, voxels=options.voxels)
    each = partial(makers[options.kind], methods=methods)
    found = []
    with parallel_map(thread_count()) as mapped:
        for angles in mapped(each, range(count)):
            found.append(angles)
            print(f"shape {len(found)} of {count}", flush=True)
    rows = {name: np.mean([angles[name] for angles in found], axis=0).tolist() for name in found[0]}
    figures = {"columns": ["mesh", *methods], "rows": rows}
    results.report(options.kind if options.record else None, figures, table)


def table(figures: results.Figures) -> str:
    """Return a row for each kind of mesh: the mean angle of the mesh and of the result of each method."""
    rows = [[name, *(f"{angle:.1f}" for angle in angles)] for name, angles in figures["rows"].items()]
    return results.markdown(["mean angle, degrees", *figures["columns"]], rows)


def until_valid(make: Callable[[], Made]) -> Made:
    """Make a shape again until it is valid."""
    while True:
        try:
            return make()
        except UnfitShapeError:
            continue


def drawn(family: ShapeFamily, rng: np.random.Generator) -> tuple[DistanceField, Extent]:
    """Draw a shape."""
    field = family.shape(0.05, rng)
    return field, extent_of(field, rng=rng)


def scan(
    family: ShapeFamily, measure: Callable[..., Measured], rng: np.random.Generator
) -> tuple[DistanceField, Measured]:
    """Draw a shape and measure it."""
    field, extent = drawn(family, rng)
    return field, measure(field, extent, faces=2 * FACES, rng=rng)


def of_levels(number: int, *, methods: Sequence[str]) -> dict[str, list[float]]:
    """Return the angles of a shape at each level of error."""
    found = {}
    for name, (make, level) in ERRORS.items():
        rng = np.random.default_rng([SEEDS["levels"], number])
        made = until_valid(partial(make, SHAPE_FAMILIES[SHAPES[number % len(SHAPES)]], level, rng))
        found[name] = angles_of(made.noisy, made.normals, methods)
    return found


def of_extractors(number: int, *, methods: Sequence[str], voxels: int) -> dict[str, list[float]]:
    """Label a shape and mesh it by each extractor; return the angles."""
    rng = np.random.default_rng([SEEDS["extractors"], number])
    field, extent = until_valid(partial(drawn, SHAPE_FAMILIES[SHAPES[number % len(SHAPES)]], rng))
    size = float(np.max(extent.upper - extent.lower) / voxels)
    nodes = grid(0.5 * (extent.upper - extent.lower) + 3 * size, np.full(3, size)) + extent.middle
    mask = (field(nodes.reshape(-1, 3)) < 0).reshape(nodes.shape[:3])
    found = {}
    for name, extract in EXTRACTORS.items():
        made = placed(field, extract(mask).triangulate().clean(), nodes[0, 0, 0], size)
        found[name] = angles_of(made.noisy, made.normals, methods)
    return found


def of_elongated(number: int, *, methods: Sequence[str]) -> dict[str, list[float]]:
    """Return the angles of a parametric surface at each level of noise."""
    surface = SURFACES[number % len(SURFACES)]().triangulate().clean()
    clean = Mesh(np.asarray(surface.points, np.float64), surface.faces.reshape(-1, 4)[:, 1:])
    height = np.median(clean.heights)
    found = {}
    for share in HEIGHTS:
        heights = np.random.default_rng([SEEDS["elongated"], number]).normal(0, share * height, len(clean.vertices))
        noisy = clean.moved(clean.vertices + heights[:, None] * clean.vertex_normals)
        found[f"noise of {share:g} heights"] = angles_of(noisy, clean.face_normals, methods)
    return found


def of_decimated(number: int, *, methods: Sequence[str]) -> dict[str, list[float]]:
    """Return the angles of decimated measured surfaces of a shape and of a decimated clean one."""
    found, family = {}, SHAPE_FAMILIES[SHAPES[number % len(SHAPES)]]
    for name, measure in MEASUREMENTS.items():
        rng = np.random.default_rng([SEEDS["decimated"], number])
        field, made = until_valid(partial(scan, family, measure, rng))
        for share in REMOVED:
            mesh = beneath(field, without_share(made.noisy, share), cell=made.noisy.mean_edge_length)
            found[f"{name}, {share:.0%} of the faces removed"] = angles_of(mesh.noisy, mesh.normals, methods)
    fine = family.make(faces=4 * FACES, rng=np.random.default_rng([SEEDS["decimated"], number])).clean
    clean = without_share(fine, CLEAN_REMOVED)
    found[f"clean, {CLEAN_REMOVED:.0%} of the faces removed"] = angles_of(clean, clean.face_normals, methods)
    return found


def of_reliefs(number: int, *, methods: Sequence[str]) -> dict[str, list[float]]:
    """Return the angles of level surfaces of a shape with each relief, whose vertices lie on the surface."""
    found = {}
    for name, (pattern, wavelengths) in RELIEFS.items():
        for edges in wavelengths:
            rng = np.random.default_rng([SEEDS["reliefs"], number])
            made = until_valid(partial(relieved, SHAPE_FAMILIES[SHAPES[number % len(SHAPES)]], pattern, edges, rng))
            found[f"{name} of {edges:g} edges"] = angles_of(made.noisy, made.normals, methods)
    return found


def relieved(
    family: ShapeFamily, pattern: Callable[..., DistanceField], edges: float, rng: np.random.Generator
) -> Measured:
    """Draw a shape, add a relief to it, and mesh it by marching cubes."""
    field, extent = drawn(family, rng)
    mesher, density, _ = MESHERS["cubes"]
    voxel = float(np.sqrt(density * extent.area / FACES))
    wavelength = edges * EDGE * voxel
    field = pushed_out(field, pattern(wavelength=wavelength, rng=rng), amplitude=RELIEF_HEIGHT * wavelength)
    mesh = onto_level(field, level_surface(field, extent, mesher, voxel=voxel, rng=rng), voxel)
    return beneath(field, mesh, cell=voxel)


def without_share(mesh: Mesh, share: float) -> Mesh:
    """Remove a fraction of the faces of a mesh by quadrics."""
    import pyvista

    small = pyvista.PolyData.from_regular_faces(mesh.vertices, mesh.faces).decimate(share)
    return Mesh(np.asarray(small.points, np.float64), small.regular_faces)


def placed(field: DistanceField, made: Any, origin: NDArray[np.float64], size: float) -> Measured:
    """Place a mesh in voxel coordinates over its shape, oriented outward."""
    faces = made.faces.reshape(-1, 4)[:, 1:]
    noisy = Mesh(origin + size * np.asarray(made.points, np.float64), faces)
    found = beneath(field, noisy, cell=size)
    if np.einsum("ij,ij", noisy.area_vectors, found.normals) < 0:
        found = beneath(field, Mesh(noisy.vertices, faces[:, ::-1]), cell=size)
    return found


def angles_of(noisy: Mesh, normals: NDArray[np.float64], methods: Sequence[str]) -> list[float]:
    """Return the mean angle by area to the known true normals, of a mesh and of the result of each method."""
    return [angle(mesh, normals) for mesh in (noisy, *(running.denoised(noisy, method) for method in methods))]


def angle(mesh: Mesh, normals: NDArray[np.float64]) -> float:
    """Return the mean angle by area to the true normals, in degrees; a zero normal is unknown."""
    known = normals.any(axis=1) & mesh.face_normals.any(axis=1)
    angles = angles_between(mesh.face_normals[known], normals[known])
    return float(np.degrees(np.average(angles, weights=mesh.areas[known])))


if __name__ == "__main__":
    main()
