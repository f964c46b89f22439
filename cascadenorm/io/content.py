"""Format-independent content: positions, polygons, attributes, colours, labels."""

from collections.abc import Callable, Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from cascadenorm.errors import OutputError, counted
from cascadenorm.io.text.text import Text
from cascadenorm.io.text.tokenizer import Offsets
from cascadenorm.mesh import Bools, any_in_rows, first_places, marked
from cascadenorm.mesh.polygons import Polygons

Positions = NDArray[Any]  # (k, 3) float32 or float64, as stored in the file


@dataclass(frozen=True)
class Content:
    """Content for conversion between formats. Attributes have the names that PLY uses."""

    positions: Positions
    polygons: Polygons  # faces; corners are rows of `positions`
    # name -> (k,) values; colours are red, green, blue, alpha as uint8, texture coordinates are s, t
    vertex_values: Mapping[str, NDArray[Any]] = field(default_factory=dict)
    face_values: Mapping[str, NDArray[Any]] = field(default_factory=dict)  # name -> one value per polygon
    left_out: tuple[str, ...] = ()  # other content of the source, in words

    def without_out_of_range(self) -> "Content":
        """Remove polygons with indices out of range, which could become valid in another file."""
        corners = self.polygons.out_of_range(len(self.positions))
        if not corners.any():
            return self
        bad = marked(self.polygons.owners[corners], len(self.polygons))
        what = "face that references a vertex that does not exist", "faces that reference vertices that do not exist"
        lost = counted(int(bad.sum()), *what)
        return replace(self.with_polygons(~bad), left_out=(*self.left_out, lost))

    def with_polygons(self, kept: Bools) -> "Content":
        """Return the content with only some of its polygons, (p,) bool."""
        polygons = Polygons.from_counts(self.polygons.counts[kept], self.polygons.corners[kept[self.polygons.owners]])
        values = {name: values[kept] for name, values in self.face_values.items()}
        return replace(self, polygons=polygons, face_values=values)

    def lost_values(self, of_vertices: Collection[str] = (), of_faces: Collection[str] = ()) -> list[str]:
        """Return what is lost in a file that keeps only properties with these names, in words."""
        lost = [f"vertex property '{name}'" for name in self.vertex_values if name not in of_vertices]
        return lost + [f"face property '{name}'" for name in self.face_values if name not in of_faces]

    def lost_as_triangles(
        self, of_vertices: Collection[str] = (), of_faces: Collection[str] = (), *, single: bool = True
    ) -> list[str]:
        """Return what is lost in a file of triangles, whose positions may have single precision, in words."""
        lost = self.lost_values(of_vertices, of_faces)
        if (self.polygons.counts != 3).any():
            lost.append("polygons (cut into triangles)")
        if single and (self.single_positions() != self.positions).any():
            lost.append("digits of the positions beyond single precision")
        return lost

    def single_positions(self) -> NDArray[np.float32]:
        """Return the positions in single precision. Raises OutputError if one exceeds its range."""
        with np.errstate(over="ignore"):
            single = self.positions.astype(np.float32)
        bad = any_in_rows(np.isinf(single) & np.isfinite(self.positions))
        if bad.any():
            raise OutputError(
                f"{bad.sum()} vertices exceed the largest number of this format, 3.4e38 (vertices "
                f"{first_places(bad)}): write ply, obj or off, or scale the mesh down"
            )
        return single


def single_numbers(arrays: Iterable[tuple[str, Sequence[Any]]], of: str) -> tuple[dict[str, NDArray[Any]], list[str]]:
    """Join the blocks of arrays with one number per row; return the other arrays in words, as data `of` something.

    Colours and texture coordinates under the names that VTK and PyVista give them are split into numbers.
    """
    numbers, left_out = dict[str, NDArray[Any]](), list[str]()
    for name, blocks in arrays:
        shapes = {(block.shape[1:], block.dtype.kind) for block in map(np.asarray, blocks)}
        if all(np.size(block) == len(block) for block in blocks):
            numbers[name] = np.concatenate([np.ravel(block) for block in blocks])
        elif (name.lower(), shapes) in (("rgb", {((3,), "u")}), ("rgba", {((4,), "u")})):
            numbers |= zip(CHANNELS, np.concatenate(blocks).T, strict=False)
        elif name.lower() in TEXTURE_ARRAYS and shapes == {((2,), "f")}:
            numbers |= zip(TEXTURE, np.concatenate(blocks).T, strict=True)
        else:
            left_out.append(f"{of} data '{name}'")
    return numbers, left_out


def with_distinct_names(
    values: Mapping[str, NDArray[Any]], valid: Callable[[str], str], taken: Collection[str] = ()
) -> dict[str, NDArray[Any]]:
    """Return values under valid names, with underscores appended to those that are taken or occur twice."""
    found: dict[str, NDArray[Any]] = {}
    for name, value in values.items():
        new = valid(name)
        while new in found or new in taken or (new != name and new in values):
            new += "_"
        found[new] = value
    return found


class Labels(NamedTuple):
    """Labels of one kind of the faces of a file."""

    kind: str  # "material", "group", "object", "mesh", or the name of a face property
    values: NDArray[Any]  # (c,) names or numbers, possibly repeated
    of_faces: NDArray[np.int64]  # (p,) row of the value of each polygon; -1 for none

    @classmethod
    def of_parts(cls, kind: str, names: Sequence[str], sizes: Sequence[int]) -> "Labels":
        """Label consecutive parts of these numbers of polygons with their names. An empty name is no label."""
        values, owner = np.array(names, str), np.repeat(np.arange(len(names)), sizes)
        return cls(kind, values, np.where(values[owner] == "", -1, owner))

    def carrying(self, value: str) -> NDArray[np.bool_]:
        """Return (p,) which polygons have a label. A number may be given as text."""
        try:
            wanted = value if self.values.dtype.kind == "U" else float(value)
        except ValueError:
            return np.zeros(len(self.of_faces), bool)
        return np.append(self.values == wanted, False)[self.of_faces]


CHANNELS = ("red", "green", "blue", "alpha")
TEXTURE = ("s", "t")  # names of texture coordinates among the vertex values
TEXTURE_NAMES = (TEXTURE, ("texture_u", "texture_v"), ("u", "v"))  # further names of them in PLY files
TEXTURE_ARRAYS = ("tcoords", "texturecoordinates", "texture coordinates")
"""Names of arrays of texture coordinates in VTK files, in lower case."""


def from_words(text: Text, words: Offsets) -> dict[str, NDArray[Any]]:
    """Parse words (k, 3 or 4) as channels, in bytes. Values are 0 … 255, or fractions if all are below 2."""
    values = text.numbers(words)
    scaled = as_bytes(values, 255 if (values >= 2).any() else 1)
    return dict(zip(CHANNELS, scaled.T, strict=False))


def channels(values: Mapping[str, NDArray[Any]]) -> dict[str, NDArray[np.uint8]]:
    """Return the channels among attributes as bytes; empty without red, green and blue.

    Values are 0 … 255 in any type, unless floating-point numbers are all below 2 or integers exceed 255.
    """
    if any(name not in values for name in CHANNELS[:3]):
        return {}
    found = {name: values[name] for name in CHANNELS if name in values}
    largest = {
        kind: _largest(kind, np.concatenate([value for value in found.values() if value.dtype == kind]))
        for kind in {value.dtype for value in found.values()}
    }
    return {name: as_bytes(value, largest[value.dtype]) for name, value in found.items()}


def _largest(kind: np.dtype[Any], values: NDArray[Any]) -> int:
    """Return the number that stands for full brightness."""
    if kind.kind not in "iu":
        return 255 if (values >= 2).any() else 1
    return int(np.iinfo(kind).max) if (values > 255).any() else 255


def as_bytes(values: NDArray[Any], largest: float = 1) -> NDArray[np.uint8]:
    """Convert channels in 0 … largest to bytes."""
    if values.dtype == np.uint8 and largest == 255:
        return values
    with np.errstate(invalid="ignore", over="ignore"):
        return np.asarray(np.nan_to_num(np.clip(np.rint(values * (255 / largest)), 0, 255)).astype(np.uint8))


class Look(NamedTuple):
    """Colours (k, 3) as fractions in float32, texture coordinates (k, 2), and the names of the values they contain."""

    colors: NDArray[Any] | None
    texture: NDArray[Any] | None
    names: tuple[str, ...]

    @classmethod
    def of(cls, values: Mapping[str, NDArray[Any]]) -> "Look":
        """Return the colours and texture coordinates among the values of vertices; None for missing ones."""
        rgb = [channel.astype(np.float32) for name, channel in channels(values).items() if name != "alpha"]
        pair = next((pair for pair in TEXTURE_NAMES if all(name in values for name in pair)), ())
        st = [values[name] for name in pair]
        colors = np.stack(rgb, axis=1) / np.float32(255) if rgb else None
        return cls(colors, np.stack(st, axis=1) if st else None, CHANNELS[: len(rgb)] + pair)
