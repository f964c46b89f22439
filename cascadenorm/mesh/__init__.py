"""Triangle meshes: geometry, topology, validation and support for kernels."""

from cascadenorm.compute.arrays import (
    Bools,
    Bytes,
    Floats,
    Floats32,
    Index,
    Ints,
    Ints32,
    Vectors,
    all_in_rows,
    angles_between,
    any_in_rows,
    as_array,
    box_of,
    doubled,
    first_of_each,
    first_places,
    marked,
    pair_products,
    row_distances,
    row_lengths,
    scatter_add,
    unit,
)
from cascadenorm.compute.csr import Csr, joined_rows
from cascadenorm.compute.equal_rows import repeats
from cascadenorm.compute.kernels import kernel
from cascadenorm.compute.threads import (
    SMALLEST_COSTLY_CHUNK,
    in_blocks,
    limit_threads,
    one_blas_thread,
    parallel_for,
    thread_count,
)
from cascadenorm.errors import MeshError
from cascadenorm.mesh.frame import in_frame, scale_between, scaled_alike
from cascadenorm.mesh.isolation import (
    bad_faces,
    bad_vertices,
    isolated,
    part_of,
    repeats_vertex,
    surface_of,
    with_part_moved,
    without_lines,
    without_repeated_faces,
)
from cascadenorm.mesh.mesh import Mesh, face_area_vectors
from cascadenorm.mesh.ordering import ordered_for_cache
from cascadenorm.mesh.topology import Topology, connected_components

__all__ = [
    "SMALLEST_COSTLY_CHUNK", "Bools", "Bytes", "Csr", "Floats", "Floats32", "Index", "Ints", "Ints32", "Mesh",
    "MeshError", "Topology", "Vectors", "all_in_rows", "angles_between", "any_in_rows", "as_array", "bad_faces",
    "bad_vertices", "box_of", "connected_components", "doubled", "face_area_vectors", "first_of_each",
    "first_places", "in_blocks", "in_frame", "isolated", "joined_rows", "kernel", "limit_threads",
    "marked", "one_blas_thread", "ordered_for_cache", "pair_products", "parallel_for", "part_of", "repeats",
    "repeats_vertex", "row_distances", "row_lengths", "scale_between", "scaled_alike", "scatter_add", "surface_of",
    "thread_count", "unit", "with_part_moved", "without_lines", "without_repeated_faces",
]  # fmt: skip
