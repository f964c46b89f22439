"""Format-independent content: positions, polygons, attributes, labels."""

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from cascadenorm.errors import OutputError
from cascadenorm.mesh import any_in_rows, first_places
from cascadenorm.mesh.polygons import Polygons

Positions = NDArray[Any]
"""(k, 3) float32 or float64, as stored in the file."""


@dataclass(frozen=True)
class Content:
    """Content for conversion between formats. Attributes have the names that PLY uses.

    Parameters
    ----------
    positions
        (k, 3) float32 or float64.
    polygons
        Faces. Corners are rows of `positions`.
    vertex_values
        Name -> (k,) values. Colours are red, green, blue, alpha as uint8; texture coordinates are s, t.
    face_values
        Name -> one value per polygon.
    left_out
        Other content of the source that is not included, in words.
    """

    positions: Positions
    polygons: Polygons
    vertex_values: Mapping[str, NDArray[Any]] = field(default_factory=dict)
    face_values: Mapping[str, NDArray[Any]] = field(default_factory=dict)
    left_out: tuple[str, ...] = ()

    def without_out_of_range(self) -> "Content":
        """Remove polygons with indices out of range, which could become valid in another file."""
        corners = self.polygons.out_of_range(len(self.positions))
        if not corners.any():
            return self
        bad = np.zeros(len(self.polygons), bool)
        bad[self.polygons.owners[corners]] = True
        return replace(
            self,
            polygons=Polygons.from_counts(
                self.polygons.counts[~bad], self.polygons.corners[~bad[self.polygons.owners]]
            ),
            face_values={name: values[~bad] for name, values in self.face_values.items()},
            left_out=(*self.left_out, f"{bad.sum()} faces that reference vertices that do not exist"),
        )

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
