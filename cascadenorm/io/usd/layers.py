"""Read, copy and write the layers of a USD file: text, binary or an archive."""

import os
import posixpath
import re
import sys
import tempfile
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from struct import Struct
from threading import Lock
from typing import Any

from cascadenorm.errors import OutputError, ReadError, reason
from cascadenorm.io.libraries import explained, unzipped
from cascadenorm.io.limits import expansion_limit
from cascadenorm.io.sidecar_files import is_within

CRATE = b"PXR-USDC"  # first bytes of a binary layer
TEXT = b"#usda"
"""First bytes of a text layer."""
LAYER_EXTENSIONS = (".usd", ".usda", ".usdc")
ENTRY = Struct("<16sQQ")  # an entry in the table of contents of a binary layer: name, begin, size
COUNTED_SECTIONS = (b"TOKENS", b"STRINGS", b"FIELDS", b"FIELDSETS", b"PATHS", b"SPECS")
"""Sections of a binary layer that begin with the number of their entries."""
MOST_PER_BYTE = 1024
"""Upper limit of entries per byte of a section: LZ4 expands up to 255 times, and an integer takes at least 2 bits."""
LEAST_MEMORY = 1 << 30  # bytes that reading a binary layer may take in any case
PARSED_AT = re.compile(r"^.*?[/\\]\d+\.usd:(\d+):(\d+): ")
"""Beginning of a message about a text layer: the name of the temporary file, the line and the column."""
PARSER = re.compile(r"\bpxrInternal\w*::(Sdf_TextFileFormatParser::)?")
"""Namespaces of the rules that messages about text layers name."""
DATE = 315_640_800
"""Date of the files in an archive, 2 January 1980 in any time zone, so that the bytes depend only on the content. ZIP
has no earlier year."""
SINGLE = "layer.usd"  # name of the layer of a file that is not an archive

_LIMITING = Lock()  # held while the memory of the process is limited
Layers = dict[str, Any]
"""Layers by their names in an archive. The first is the root."""


def files_within(data: bytes, format: str) -> dict[str, bytes]:
    """Return the files in a USD file by name. Raises ReadError for a damaged archive."""
    if format != "usdz":
        return {SINGLE: data}
    found = unzipped(data, format)
    files = dict(found)
    if len(files) < len(found) or not all(map(is_within, files)):
        raise ReadError("this usdz file holds two files of one name, or one outside the archive: export it again")
    return files


def opened(files: Mapping[str, bytes]) -> Layers:
    """Open the layers among files. Raises ReadError. Referenced files are not read."""
    from pxr import Sdf

    layers: Layers = {}
    with quiet(), tempfile.TemporaryDirectory(ignore_cleanup_errors=True) as folder:
        for number, (name, data) in enumerate(files.items()):
            if not name.lower().endswith(LAYER_EXTENSIONS):
                continue
            if not data.startswith((CRATE, TEXT)):
                raise ReadError("the file is not USD: it begins neither with '#usda' nor with 'PXR-USDC'")
            if data.startswith(CRATE):
                _check_sections(data)
            path = Path(folder) / f"{number}.usd"
            path.write_bytes(data)
            with explained("OpenUSD cannot read this file", said=said), _limited_memory(len(data)):
                layer = Sdf.Layer.OpenAsAnonymous(str(path))
                if layer is None:
                    raise ReadError("OpenUSD cannot read this file: it gives no reason")
                layers[name] = copied(layer) if data.startswith(CRATE) else layer  # the copy has read all values
    if not layers or next(iter(files)) not in layers:
        raise ReadError("the first file of this usdz archive is no USD layer: export it again")
    return layers


def copied(layer: Any) -> Any:
    """Return an independent copy of a layer. Raises ReadError, since OpenUSD reads values of binary layers only now."""
    from pxr import Sdf

    copy = Sdf.Layer.CreateAnonymous(".usda")
    with explained("OpenUSD cannot read this file", said=said), quiet():
        copy.TransferContent(layer)
    return copy


def layer_bytes(layer: Any, *, binary: bool) -> bytes:
    with quiet(), tempfile.TemporaryDirectory(ignore_cleanup_errors=True) as folder:
        path = Path(folder) / ("layer.usdc" if binary else "layer.usda")
        with explained("OpenUSD cannot write this file", OutputError, hint="choose ply or glb", said=said):
            layer.Export(str(path))
            return path.read_bytes()


def usdz_archive(files: Mapping[str, bytes]) -> bytes:
    """Return an archive of files, uncompressed and aligned as USDZ requires."""
    from pxr import Sdf

    with quiet(), tempfile.TemporaryDirectory(ignore_cleanup_errors=True) as folder:
        target = Path(folder) / "archive.usdz"
        with explained("OpenUSD cannot write this archive", OutputError, hint="choose usdc", said=said):
            with Sdf.ZipFileWriter.CreateNew(str(target)) as archive:
                for number, (name, data) in enumerate(files.items()):
                    path = Path(folder) / str(number)
                    path.write_bytes(data)
                    os.utime(path, (DATE, DATE))
                    archive.AddFile(str(path), name)
            return target.read_bytes()


def layers_named_by(layer: Any) -> list[str]:
    """Return the paths of other layers that a layer consists of, only sublayers if it is damaged."""
    with explained("OpenUSD cannot read this file", said=said), quiet():
        prims = _prims(layer)
        if not prims or not all(prims):
            return list(layer.subLayerPaths)
        return list(layer.GetCompositionAssetDependencies())


def _prims(layer: Any) -> list[Any]:
    """Return the prims of a layer; None for those that a damaged layer lists but does not have."""
    paths: list[Any] = []
    layer.Traverse("/", paths.append)
    return [layer.GetPrimAtPath(path) for path in paths if path.IsPrimPath()]


def references(layer: Any) -> list[str]:
    """Return the paths of all files that a layer references, such as layers and textures."""
    from pxr import UsdUtils

    found: dict[str, str] = {}
    with quiet():
        UsdUtils.ModifyAssetPaths(copied(layer), lambda path: found.setdefault(path, path))
    return [path for path in found if path]


def without_files_outside(layers: Layers) -> tuple[Layers, list[str]]:
    """Return copies of layers that reference only each other, and the paths of the layers left out."""
    kept, left_out = {name: copied(layer) for name, layer in layers.items()}, dict[str, None]()
    with quiet():
        for name, layer in kept.items():
            for path in layer.GetCompositionAssetDependencies():
                if path and target(path, name, layers) is None:
                    layer.UpdateCompositionAssetDependency(path, "")
                    left_out[path] = None
            for prim in _prims(layer):
                if prim is not None and prim.HasInfo("clips"):  # value clips in other files
                    prim.ClearInfo("clips")
    return kept, list(left_out)


def target(path: str, name: str, layers: Layers) -> str | None:
    """Return the name of the layer that a path in another layer refers to, or None if it is not among the layers."""
    near = posixpath.normpath(posixpath.join(posixpath.dirname(name), path))
    return next((found for found in (near, posixpath.normpath(path)) if found in layers), None)


@contextmanager
def _limited_memory(size: int) -> Iterator[None]:
    """On Linux, let allocations fail that exceed what a file of a given size may expand to.

    OpenUSD believes the sizes of arrays in a damaged binary layer, and would allocate and fill all memory.
    """
    if sys.platform != "linux":
        yield
        return
    import resource

    with _LIMITING:
        soft, hard = resource.getrlimit(resource.RLIMIT_AS)
        used = int(Path("/proc/self/statm").read_text(encoding="ascii").split()[0]) * resource.getpagesize()
        limit = used + int(max(LEAST_MEMORY, expansion_limit(size)))
        if soft == resource.RLIM_INFINITY or limit < soft:
            resource.setrlimit(resource.RLIMIT_AS, (limit, hard))
        try:
            yield
        finally:
            resource.setrlimit(resource.RLIMIT_AS, (soft, hard))


@contextmanager
def quiet() -> Iterator[None]:
    """Keep OpenUSD from writing its diagnostics to stderr."""
    from pxr import UsdUtils

    delegate = UsdUtils.CoalescingDiagnosticDelegate()
    try:
        yield
    finally:
        del delegate


def _check_sections(data: bytes) -> None:
    """Raise ReadError if a section exceeds the file or declares too many entries, at which OpenUSD would crash."""
    place = int.from_bytes(data[16:24], "little")
    count = int.from_bytes(data[place : place + 8], "little")
    table = data[place + 8 : place + 8 + ENTRY.size * min(count, len(data))]
    sections = [ENTRY.unpack_from(table, at) for at in range(0, len(table) - ENTRY.size + 1, ENTRY.size)]
    if not count or len(sections) < count or max(begin + size for _, begin, size in sections) > len(data):
        raise ReadError("the file is truncated or damaged: a section of it runs past its end")
    for name, begin, size in sections:
        entries = int.from_bytes(data[begin : begin + 8], "little")
        if name.rstrip(b"\0") in COUNTED_SECTIONS and entries > MOST_PER_BYTE * size:
            raise ReadError("the file is damaged: a section of it declares more entries than it can hold")


def said(error: Exception) -> str:
    """Return the message of an OpenUSD error without source locations and names of temporary files."""
    try:
        lines = [line for line in str(error).splitlines() if " : '" in line]
        text = " ".join(lines[-1].partition(" : '")[2].split()) if lines else ""
        text = re.sub("(Corrupt asset |, while reading )[<@][^>@]*[>@](: | - )?", "", text)
        text = PARSED_AT.sub(r"line \1, column \2: ", PARSER.sub("", text))
        return (text.rstrip("'\" ") or ("it is damaged" if lines else reason(error)))[:200]
    except UnicodeDecodeError:  # the message quotes bytes of the file
        return "it is damaged"
