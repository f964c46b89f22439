"""Read and write mesh files of any format."""

import codecs
import os
import re
from collections.abc import Iterable, Mapping
from io import BytesIO, TextIOBase, UnsupportedOperation
from pathlib import Path
from typing import BinaryIO, cast
from zipfile import ZipFile

import numpy as np
from numpy.typing import ArrayLike

from cascadenorm.errors import MissingDependencyError, OutputError, ReadError
from cascadenorm.io.atomic import check_output, is_special, make_folder, unfinished_name, write_stream, write_together
from cascadenorm.io.base import MeshFile, Piece
from cascadenorm.io.gltf.gltf import GlbFile, GltfFile
from cascadenorm.io.libraries import is_installed
from cascadenorm.io.neuroimaging import FREESURFER_EXTENSIONS, FREESURFER_MAGIC, FreeSurferFile, GiftiFile
from cascadenorm.io.obj import ObjFile
from cascadenorm.io.off import OFF_HEADER, OffFile
from cascadenorm.io.ply.ply import ArraysFile, PlyFile
from cascadenorm.io.polydata import LEGACY, LegacyPolyDataFile, PolyDataFile
from cascadenorm.io.sidecar_files import copy_beside, is_scene, sidecar_files
from cascadenorm.io.stl import StlFile, is_binary_stl
from cascadenorm.io.usd.layers import LAYER_EXTENSIONS
from cascadenorm.io.usd.usd import UsdaFile, UsdcFile, UsdFile, UsdzFile, layer_format
from cascadenorm.io.via_trimesh import TRIMESH_NEEDS, trimesh_formats, trimesh_kind
from cascadenorm.io.vtk import AbaqusFile, GmshFile, VtkFile, VtuFile
from cascadenorm.io.xml.collada import ColladaFile
from cascadenorm.io.xml.threemf import ThreemfFile
from cascadenorm.mesh import Mesh
from cascadenorm.mesh.polygons import Polygons

FORMATS: dict[str, type[MeshFile]] = {
    kind.format: kind
    for kind in (PlyFile, ObjFile, StlFile, OffFile, GlbFile, GltfFile, ThreemfFile, ColladaFile, FreeSurferFile)
}

OPTIONAL: dict[str, type[MeshFile]] = {
    kind.format: kind
    for kind in (VtkFile, VtuFile, GmshFile, AbaqusFile, PolyDataFile, UsdFile, UsdaFile, UsdcFile, UsdzFile, GiftiFile)
}
"""Formats that a further package reads and writes."""

OBJ_VERTEX, OBJ_FACE = (re.compile(rb"(?:\A|[\r\n])[ \t]*" + word + rb"[ \t]", re.I) for word in (b"v", b"f"))
"""Lines that identify an OBJ file."""

ABAQUS = re.compile(rb"\s*(?:\*\*[^\r\n]*[\r\n]\s*)*\*(?:heading|node)\b", re.I)
"""Beginning of an Abaqus file, after lines of comments."""

XML_GRIDS = {b'type="PolyData"': PolyDataFile.format, b'type="UnstructuredGrid"': VtuFile.format}
"""Formats by the type of data of a VTK file in XML."""

BEGINNINGS = {
    **dict.fromkeys((b"ply\n", b"ply\r", b"ply "), "ply"),
    FREESURFER_MAGIC: FreeSurferFile.format,
    b"# vtk DataFile": "vtk",
    b"$MeshFormat": "msh",
    b"glTF": "glb",
}
"""Formats by the first bytes of a file."""

GZIP = b"\x1f\x8b\x08"  # first bytes of a file that gzip has compressed

Source = str | os.PathLike[str] | BinaryIO


def read(source: Source, format: str | None = None) -> MeshFile:
    """Read a mesh file into memory.

    Parameters
    ----------
    source
        Path, or a stream of bytes.
    format
        Name of the format, which is also its extension. By default it is detected from the content, then taken from the
        extension.

    Returns
    -------
    The file. `with_vertices` moves its vertices and `write` writes it. Its `mesh` raises MeshError if the file does not
    contain a valid mesh.

    Raises
    ------
    ReadError
        The file is missing, unreadable, empty, truncated, damaged or not a mesh. The message contains the file name.
    """
    name, folder, data = _bytes_of(source)
    try:
        if not data:
            raise ReadError("the file is empty")
        mark = b""
        if not is_binary_stl(data):  # its header may hold any bytes
            mark = codecs.BOM_UTF8 if data.startswith(codecs.BOM_UTF8) else b""
            data = data.removeprefix(mark)
            if data.startswith((codecs.BOM_UTF16_LE, codecs.BOM_UTF16_BE)):
                raise ReadError("the file is text in UTF-16, which is not supported: save it as UTF-8")
            if data.startswith(GZIP):
                raise ReadError("the file is compressed by gzip: unpack it first")
        chosen = _format_of(format or _sniffed(data) or Path(name).suffix or layer_format(data))
        kind = _kind(chosen)
        if chosen == "vtk" and LEGACY.match(data):
            if not is_installed("vtkmodules"):
                raise MissingDependencyError("reading PolyData in 'vtk' files", package="pyvista", extra="pyvista")
            kind = LegacyPolyDataFile
        if kind is None:
            known = ", ".join(dict.fromkeys([*FORMATS, *_further_formats(), *trimesh_formats()]))
            if chosen in OPTIONAL or chosen in TRIMESH_NEEDS:
                raise _missing("reading", chosen)
            raise ReadError(
                f"{f'{chosen!r} is' if chosen else 'the content is'} not a supported mesh format ({known}): "
                "convert the file, or name its format if that is one of these"
            )
        file = kind(data, folder)
        file.mark = mark
        return file
    except ReadError as error:
        raise error.within(name) from error.__cause__


def write(
    file: MeshFile,
    target: Source,
    *,
    format: str | None = None,
    force: bool = False,
    others: Mapping[Path, Iterable[Piece]] | None = None,
) -> list[str]:
    """Write a file atomically as `cascadenorm.write` does; return what the format cannot store, in words.

    If the target is a path, `others` are the contents of further files, which are written with it or not at all.
    """
    others = others or {}
    if not isinstance(file, MeshFile):
        raise OutputError(
            f"file is of type {type(file).__name__}; it must be a MeshFile: make one with read or from_arrays"
        )
    path = Path(target) if isinstance(target, str | os.PathLike) else None
    check_stream(target)
    chosen = output_format(f".{format}" if format else target, file.format)
    if path:
        check_output(path, force=force)
    kind = _kind(chosen)
    assert kind is not None
    if file.format != chosen:
        file = file.repacked(kind) or file
    if path and file.format == chosen and not is_special(path):
        while True:
            beside, lost = sidecar_files(file, path, force=force)
            for copy in beside:
                make_folder(copy.parent)
            try:
                _write_files(file, path, {**others, **beside}, force=force)
            except OutputError:  # another process may have written the same texture in the meantime
                if len(sidecar_files(file, path, force=force)[0]) == len(beside):
                    raise
            else:
                return [*lost, *_lost(file)]
    pieces, lost = (file.pieces(), _lost(file)) if file.format == chosen else _encoded(file, kind)
    if path:
        write_together([*others.items(), (path, pieces)], force=force)
    else:
        write_stream(cast(BinaryIO, target), pieces)
    return lost


def _write_files(file: MeshFile, path: Path, beside: dict[Path, Iterable[Piece]], *, force: bool) -> None:
    """Write a file, its parts and referenced files; it never references an old part, but a temporary copy."""
    files, aside = file.files(path), dict[Path, Iterable[Piece]]()
    if any(part.exists() for part in files if part != path):
        aside = file.files(path, part_name=unfinished_name("{}", path))
    write_together([*beside.items(), *aside.items(), *files.items()], force=force)
    for part in aside:
        if part != path:
            part.unlink(missing_ok=True)


def _lost(file: MeshFile) -> list[str]:
    """Return what is lost when a file is written in its own format, in words."""
    return list(file.moving_loses) if file.moving_loses and file.has_moved else []


def extensible(file: MeshFile) -> tuple[PlyFile | ObjFile | GltfFile, list[str]]:
    """Return a file that supports additional faces, PLY for most formats, and what it lacks, in words."""
    return (file, []) if isinstance(file, GltfFile) else as_one_mesh(file)


def as_one_mesh(file: MeshFile) -> tuple[PlyFile | ObjFile, list[str]]:
    """Return a file whose content has the order of its faces, PLY for most formats, and what it lacks, in words."""
    if isinstance(file, PlyFile | ObjFile):
        return file, []
    pieces, lost = _encoded(file, PlyFile)
    return PlyFile(b"".join(pieces)), lost


def check_target(file: MeshFile, target: Source, *, format: str, force: bool) -> None:
    """Raise OutputError if a file that `write` would create beside the target already exists."""
    if format == file.format and isinstance(target, str | os.PathLike) and not is_special(target):
        path = Path(target)
        for beside in file.may_write(path):
            check_output(beside, force=force)
        sidecar_files(file, path, force=force)


def copied_names(file: MeshFile, target: Path) -> list[str]:
    """Return the names of the files, such as textures, that `write` copies beside a target in another folder.

    Buffers of a glTF are not among them, since they are parts of the mesh, nor USD layers, which are meshes themselves.
    """
    format = output_format(target, file.format)
    kind = _kind(format)
    assert kind is not None
    written = file if file.format == format else file.repacked(kind)
    named = {} if written is None else written.refers_to()
    further = [name for name, needed in named.items() if not needed and not is_scene(name)]
    return [name for name in further if copy_beside(target, name) is not None]


def check_stream(target: Source) -> None:
    """Raise OutputError if a target is neither a path nor a stream that takes bytes."""
    if isinstance(target, str | os.PathLike):
        return
    if isinstance(target, TextIOBase):
        raise OutputError(f'{stream_name(target)} is a text stream: open the file in binary mode, "wb"')
    if not hasattr(target, "write"):
        raise OutputError(
            f"the output is of type {type(target).__name__}, which is neither a path nor a stream of bytes"
        )
    if getattr(target, "closed", False):
        raise OutputError(f"{stream_name(target)} cannot be written: it is closed")
    if hasattr(target, "writable") and not target.writable():
        raise OutputError(f'{stream_name(target)} cannot be written: open the file in binary mode, "wb"')


def output_format(target: Source, otherwise: str = "") -> str:
    """Return the format of an output: that of its extension, else `otherwise`. Raises OutputError if there is none."""
    extension = os.path.splitext(f"a{Path(target).name}")[1] if isinstance(target, str | os.PathLike) else ""
    chosen = _format_of(extension or otherwise)
    if chosen in FORMATS:
        return chosen  # avoids importing the packages for other formats
    known = [*FORMATS, *_further_formats()]
    if not chosen:
        raise OutputError(f"{target} has no extension, which selects the format: choose one of {', '.join(known)}")
    if chosen not in known:
        if chosen in OPTIONAL:
            raise _missing("writing", chosen)
        raise OutputError(f"the format '{chosen}' cannot be written: choose one of {', '.join(known)}")
    return chosen


def check_extension(source: Source, target: str | os.PathLike[str]) -> None:
    """Raise OutputError if the extension of a target, or else of the source, selects no writable format."""
    if Path(target).suffix or not isinstance(source, str | os.PathLike) or Path(source).suffix:
        output_format(target)


def beside(source: Path, what: str) -> Path:
    """Return `<stem>_<what><suffix>` beside a mesh file. Raises ReadError for a folder, OutputError for a pipe."""
    if os.path.isdir(source):  # not is_dir, which raises PermissionError in a folder that cannot be searched
        raise ReadError(f"{source} is a folder", hint="give the name of a mesh file in it")
    if is_special(source):
        raise OutputError(f"{source} is a pipe or a device, which has no folder for the output", hint="give an output")
    return source.with_name(f"{source.stem}_{what}{source.suffix}")


def is_mesh_name(path: Path) -> bool:
    """Whether the extension is that of a mesh format, even if the package that reads it is missing."""
    format = _format_of(path.suffix)
    return format in OPTIONAL or format in TRIMESH_NEEDS or _kind(format) is not None


def _format_of(extension: str) -> str:
    name = extension.lower().lstrip(".")
    return FreeSurferFile.format if name in FREESURFER_EXTENSIONS else name


def _missing(work: str, format: str) -> MissingDependencyError:
    package, extra = TRIMESH_NEEDS[format] if format in TRIMESH_NEEDS else OPTIONAL[format].needs[1:]
    return MissingDependencyError(f"{work} {format!r} files", package=package, extra=extra)


def _kind(format: str) -> type[MeshFile] | None:
    return FORMATS.get(format) or _further_formats().get(format) or trimesh_kind(format)


def _further_formats() -> dict[str, type[MeshFile]]:
    return {name: kind for name, kind in OPTIONAL.items() if is_installed(kind.needs[0])}


def _encoded(file: MeshFile, kind: type[MeshFile]) -> tuple[Iterable[Piece], list[str]]:
    content = file.content()
    pieces, lost = kind.encode(content)
    return pieces, [*content.left_out, *lost]


def from_arrays(vertices: ArrayLike, faces: ArrayLike) -> MeshFile:
    """Make a binary PLY file in memory from a mesh.

    Parameters
    ----------
    vertices
        (n, 3) numbers. float32 is kept, other types are converted to float64.
    faces
        (m, 3) integers in 0 … n - 1.

    Returns
    -------
    The file, as `read` returns one.

    Raises
    ------
    MeshError
        The arrays are not a valid mesh.
    """
    mesh = Mesh(vertices, faces)
    given = getattr(vertices, "dtype", None)  # in either byte order
    kind = np.float32 if given in (np.dtype("<f4"), np.dtype(">f4")) else np.float64
    return ArraysFile(mesh.vertices.astype(kind), Polygons.from_rows(mesh.faces.astype(np.int64)))


def check_source(source: object) -> None:
    """Raise ReadError if a source is neither a path nor a stream."""
    if not isinstance(source, str | os.PathLike) and not hasattr(source, "read"):
        raise ReadError(f"source is of type {type(source).__name__}, which is neither a path nor a stream of bytes")


def _bytes_of(source: Source) -> tuple[str, Path | None, bytes]:
    """Return a name for messages, the folder or None, and the content."""
    check_source(source)
    if not isinstance(source, str | os.PathLike):
        return stream_name(source), None, _all_of(source)
    if is_url(source):
        raise ReadError(f"{os.fspath(source)} is a URL: download the file first")
    path = Path(source)
    try:
        return str(path), None if is_special(path) else path.parent, path.read_bytes()
    except IsADirectoryError:
        raise ReadError(f"{path} is a folder: give the name of a mesh file in it") from None
    except FileNotFoundError:
        if str(path) == "-":
            raise ReadError("standard input cannot be used for this mesh: give the name of a file") from None
        raise ReadError(f"{path} does not exist: check the name") from None
    except (OSError, ValueError) as error:  # ValueError: a null byte in the name
        raise ReadError(f"{path} cannot be read: {getattr(error, 'strerror', None) or error}") from error


def stream_name(stream: object) -> str:
    """Return the name of a stream for messages."""
    name = getattr(stream, "name", None)
    return name if isinstance(name, str) else "the stream"  # that of a temporary file is a number


def _all_of(stream: BinaryIO) -> bytes:
    """Return all bytes of a stream. Raises ReadError."""
    text = isinstance(stream, TextIOBase)
    try:
        data = b"" if text else stream.read()
    except UnsupportedOperation:
        raise ReadError(f'{stream_name(stream)} cannot be read: open the file in binary mode, "rb"') from None
    except (OSError, ValueError) as error:  # ValueError: the stream is closed
        why = getattr(error, "strerror", None) or error
        raise ReadError(f"{stream_name(stream)} cannot be read: {why}") from error
    if text or isinstance(data, str):
        raise ReadError(f'{stream_name(stream)} is a text stream: open the file in binary mode, "rb"')
    return bytes(data or b"")


def _sniffed(data: bytes) -> str | None:
    """Detect the format from the content."""
    if is_binary_stl(data):  # its header may begin like another format
        return "stl"
    for beginning, format in BEGINNINGS.items():
        if data.startswith(beginning):
            return format
    if data.startswith(b"PK"):
        return _sniffed_archive(data)
    if b"<GIFTI" in data[:1000]:
        return GiftiFile.format
    if b"<COLLADA" in data[:1000]:
        return ColladaFile.format
    if b"<VTKFile" in data[:1000]:
        return next((format for kind, format in XML_GRIDS.items() if kind in data[:1000]), None)
    if ABAQUS.match(data):
        return AbaqusFile.format
    if data.lstrip().startswith(b"{") and b'"asset"' in data:
        return "gltf"
    if OFF_HEADER.match(data):
        return "off"
    if re.match(rb"\s*solid\s", data, re.I):
        return "stl"
    faces = data.rfind(b"\nf ") >= 0 or OBJ_FACE.search(data)  # most files end with faces
    return "obj" if faces and OBJ_VERTEX.search(data, 0, 100_000) else None


def _sniffed_archive(data: bytes) -> str | None:
    """Detect the format of a ZIP archive from the names in it."""
    try:
        with ZipFile(BytesIO(data)) as archive:
            names = [name.lower() for name in archive.namelist()]
    except Exception:  # any error for a damaged archive
        return None
    if any(name.endswith(".model") for name in names):
        return ThreemfFile.format
    return UsdzFile.format if names and names[0].endswith(LAYER_EXTENSIONS) else None


def is_url(name: object) -> bool:
    """Whether a name is a URL. "C://" is a drive."""
    return isinstance(name, str) and re.match(r"[A-Za-z][A-Za-z0-9+.-]+://", name) is not None
