"""Reading and writing mesh files."""

from cascadenorm.errors import OutputError, ReadError
from cascadenorm.io.base import MeshFile
from cascadenorm.io.files import from_arrays, is_mesh_name, output_format, read, write

__all__ = ["MeshFile", "OutputError", "ReadError", "from_arrays", "is_mesh_name", "output_format", "read", "write"]
