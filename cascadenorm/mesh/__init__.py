"""Triangle meshes: arrays, topology, geometry, checks, and threads for the kernels that walk over them."""

from cascadenorm.mesh.mesh import Mesh, MeshError, Vectors, first_places, unit
from cascadenorm.mesh.threads import kernel, limit_threads, over, thread_count
from cascadenorm.mesh.topology import Csr, Topology

__all__ = [
    "Csr",
    "Mesh",
    "MeshError",
    "Topology",
    "Vectors",
    "first_places",
    "kernel",
    "limit_threads",
    "over",
    "thread_count",
    "unit",
]
