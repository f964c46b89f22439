"""Read, copy and write the layers of a USD file.

Layers are stored as text, binary or an archive.
"""

import posixpath
import re
import sys
import tempfile
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from threading import Lock
from typing import Any

from cascadenorm.errors import OutputError, ReadError, reason
from cascadenorm.io.libraries import explained, unzipped
from cascadenorm.io.limits import expansion_limit
from cascadenorm.io.references import is_within

CRATE = b"PXR-USDC"
"""First bytes of a binary layer."""
TEXT = b"#usda"
"""First bytes of a text layer."""
EXTENSIONS = (".usd", ".usda", ".usdc")
SECTION = 32
"""Size in bytes of an entry in the table of contents of a binary layer: name, begin, size."""
COUNTED = (b"TOKENS", b"STRINGS", b"FIELDS", b"FIELDSETS", b"PATHS", b"SPECS")
"""Sections of a binary layer that begin with the number of their entries."""
MOST_PER_BYTE = 1024
"""Upper limit of entries per byte of a section: LZ4 expands up to 255 times, and an integer takes at least 2 bits."""
LEAST_MEMORY = 1 << 30
"""Bytes that reading a binary layer may take in any case."""
SINGLE = "layer.usd"
"""Name of the layer of a file that is not an archive."""

_LIMITING = Lock()
"""Held while the memory of the process is limited."""
Layers = dict[str, Any]
"""Layers by their names in an archive. The first is the root."""


def unpacked(data: bytes, format: str) -> dict[str, bytes]:
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
            if not name.lower().endswith(EXTENSIONS):
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


def written(layer: Any, *, binary: bool) -> bytes:
    """Return the bytes of a layer."""
    with quiet(), tempfile.TemporaryDirectory(ignore_cleanup_errors=True) as folder:
        path = Path(folder) / ("layer.usdc" if binary else "layer.usda")
        with explained("OpenUSD cannot write this file", OutputError, hint="choose ply or glb", said=said):
            layer.Export(str(path))
            return path.read_bytes()


def packed(files: Mapping[str, bytes]) -> bytes:
    """Return an archive of files, uncompressed and aligned as USDZ requires."""
    from pxr import Sdf

    with quiet(), tempfile.TemporaryDirectory(ignore_cleanup_errors=True) as folder:
        target = Path(folder) / "archive.usdz"
        with explained("OpenUSD cannot write this archive", OutputError, hint="choose usdc", said=said):
            with Sdf.ZipFileWriter.CreateNew(str(target)) as archive:
                for number, (name, data) in enumerate(files.items()):
                    path = Path(folder) / str(number)
                    path.write_bytes(data)
                    archive.AddFile(str(path), name)
            return target.read_bytes()


def layers_named_by(layer: Any) -> list[str]:
    """Return the paths of the other layers that a layer consists of.

    For a damaged layer that lists prims it does not have, only sublayers are returned: OpenUSD would abort.
    """
    with explained("OpenUSD cannot read this file", said=said), quiet():
        paths: list[Any] = []
        layer.Traverse("/", paths.append)
        prims = [layer.GetObjectAtPath(path) for path in paths if path.IsPrimPath()]
        if not prims or not all(prims):
            return list(layer.subLayerPaths)
        return list(layer.GetCompositionAssetDependencies())


def references(layer: Any) -> list[str]:
    """Return the paths of all files that a layer references, such as layers and textures."""
    from pxr import UsdUtils

    found: dict[str, None] = {}

    def note(path: str) -> str:
        found[path] = None
        return path

    with quiet():
        UsdUtils.ModifyAssetPaths(copied(layer), note)
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
            paths: list[Any] = []
            layer.Traverse("/", paths.append)
            for prim in (layer.GetPrimAtPath(path) for path in paths if path.IsPrimPath()):
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
        used = int(Path("/proc/self/statm").read_text().split()[0]) * resource.getpagesize()
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
    """Raise ReadError if a section of a binary layer exceeds the file or declares more entries than it can hold.

    OpenUSD checks neither. It would crash, or allocate memory for billions of entries.
    """
    place = int.from_bytes(data[16:24], "little")
    count = int.from_bytes(data[place : place + 8], "little")
    table = data[place + 8 : place + 8 + SECTION * min(count, len(data))]
    rows = [table[at + 16 : at + SECTION] for at in range(0, len(table), SECTION)]
    ends = [int.from_bytes(row[:8], "little") + int.from_bytes(row[8:], "little") for row in rows]
    if not count or len(table) < SECTION * count or max(ends) > len(data):
        raise ReadError("the file is truncated or damaged: a section of it runs past its end")
    for row in range(0, len(table), SECTION):
        name = table[row : row + 16].rstrip(b"\0")
        begin, size = (int.from_bytes(table[row + at : row + at + 8], "little") for at in (16, 24))
        if name in COUNTED and int.from_bytes(data[begin : begin + 8], "little") > MOST_PER_BYTE * size:
            raise ReadError("the file is damaged: a section of it declares more entries than it can hold")


def said(error: Exception) -> str:
    """Return the message of an OpenUSD error without source locations."""
    try:
        lines = [line for line in str(error).splitlines() if " : '" in line]
        text = " ".join(lines[-1].partition(" : '")[2].split()) if lines else ""
        text = re.sub("Corrupt asset <[^>]*>: ", "", text)  # the name of a temporary file
        return (text.rstrip("'\" ") or reason(error))[:200]
    except UnicodeDecodeError:  # the message quotes bytes of the file
        return "it is damaged"
