"""Mesh files in memory that several files of tests read."""

from cascadenorm import io
from cascadenorm.io.content import Content
from cascadenorm.io.files import FORMATS
from cascadenorm.mesh.polygons import Polygons


def ply_of(vertices, faces, normals=None) -> io.MeshFile:
    values = {} if normals is None else dict(zip(("nx", "ny", "nz"), normals.T, strict=True))
    return FORMATS["ply"](b"".join(FORMATS["ply"].encode(Content(vertices, Polygons.from_rows(faces), values))[0]))
