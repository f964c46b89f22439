"""Patches of a larger mesh: denoised with a halo around them, their interiors are those of the whole.

A method sees a few numbers of the whole, which `Whole` gathers, and otherwise what lies within its receptive field.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from cascadenorm.controls.settings import CONTROLS, Controls
from cascadenorm.errors import MeshError, ParameterError
from cascadenorm.geometry.neighborhoods import steps_from
from cascadenorm.geometry.orientation import oriented
from cascadenorm.mesh import (
    Frame,
    Mesh,
    Topology,
    first_places,
    frame_of,
    ordered_for_cache,
    repeats_vertex,
    without_lines,
)
from cascadenorm.regions.shells import shells
from cascadenorm.registry import Method, find

LOCAL_CONTROLS = ("strength", "mask", "fixed", "only", "boundary", "max_displacement", "threads", "progress", "halo")
"""Controls that see no more of the mesh than the method does."""


@dataclass(frozen=True, eq=False)
class Whole:
    """What a patch needs to know of the mesh that it is a part of.

    Parameters
    ----------
    frame
        Of the whole.
    mean_edge_length
        In the frame.
    groups
        Number of groups in which the vertex update takes the vertices.
    group
        (n,) that of each vertex, -1 without a face.
    around
        (n,) number of faces around each vertex.
    flipped
        (m,) faces that are seen from their other side, so that all are consistently oriented.
    """

    frame: Frame
    mean_edge_length: float
    groups: int
    group: NDArray[np.int32]
    around: NDArray[np.int32]
    flipped: NDArray[np.bool_]

    @classmethod
    def of(cls, vertices: ArrayLike, faces: ArrayLike) -> "Whole":
        """Gather it from a mesh of n vertices, (n, 3), and m faces, (m, 3).

        Raises
        ------
        MeshError
            No valid mesh; faces that repeat a vertex; regions that share walls, which see one another.
        """
        mesh = Mesh(vertices, faces)
        if without_lines(mesh) is not mesh:
            lines = repeats_vertex(mesh.faces)
            raise MeshError(
                f"{lines.sum()} faces repeat a vertex (faces {first_places(lines)})", hint="drop them first"
            )
        frame = frame_of(mesh)
        seen = frame.of(mesh)
        order = ordered_for_cache(seen)  # the groups are those of the order in which the whole is denoised
        framed = oriented(order.mesh)
        upright = framed if order.mesh is seen else oriented(seen)
        flipped = (upright.faces != mesh.faces).any(axis=1)
        if shells(framed) is not None:
            raise MeshError("regions of this mesh share walls, which patches do not support: denoise it as a whole")
        colors = framed.topology.vertex_colors
        group = np.full(len(mesh.vertices), -1, np.int32)
        group[order.numbers[colors.indices]] = colors.rows
        around = mesh.topology.vertex_faces.counts.astype(np.int32)
        return cls(frame, framed.mean_edge_length, len(colors.counts), group, around, flipped)

    def receptive_field(self, method: str, **parameters: Any) -> int:
        """Return within how many edges of a vertex the mesh decides on its place.

        Raises
        ------
        ParameterError
            All of the mesh does.
        """
        return _rings(find(method), parameters, self.groups)

    def patch(self, faces: ArrayLike, inside: ArrayLike, rings: int) -> "Patch":
        """Return vertices of this mesh with a halo of so many rings around them.

        Parameters
        ----------
        faces
            (m, 3) those of the whole.
        inside
            (n,) bool or indices, the vertices of the patch.
        """
        every = np.asarray(faces)
        chosen = np.zeros(len(self.group), bool)
        chosen[np.asarray(inside)] = True
        near = steps_from(Topology(every.astype(np.int32), len(chosen)), chosen, rings) <= rings
        mine = near[every].all(axis=1)
        vertices = np.flatnonzero(near)
        numbers = np.full(len(near), -1, np.int32)
        numbers[vertices] = np.arange(len(vertices), dtype=np.int32)
        part = Whole(
            self.frame, self.mean_edge_length, self.groups, self.group[vertices], self.around[vertices],
            self.flipped[mine],
        )  # fmt: skip
        return Patch(vertices, numbers[every[mine]], Halo(~chosen[vertices], part))


@dataclass(frozen=True, eq=False)
class Halo:
    """The vertices of a patch that are there for the others' sake and stay as they are.

    Parameters
    ----------
    vertices
        (k,) bool.
    whole
        What the patch needs to know of the whole, its rows those of the patch.
    """

    vertices: NDArray[np.bool_]
    whole: Whole


@dataclass(frozen=True, eq=False)
class Patch:
    """A part of a mesh.

    Parameters
    ----------
    vertices
        (k,) ascending, those of the whole.
    faces
        (j, 3) by numbers in `vertices`.
    halo
        To be given to `denoise`.
    """

    vertices: NDArray[np.int64]
    faces: NDArray[np.int32]
    halo: Halo

    @property
    def inside(self) -> NDArray[np.int64]:
        """The vertices of the whole that are not in the halo."""
        return self.vertices[~self.halo.vertices]


def check_halo(method: Method, parameters: Mapping[str, Any], mesh: Mesh, controls: Controls) -> Halo:
    """Return the halo of a patch.

    Raises
    ------
    ParameterError
        A method or a control that sees all of the mesh, a halo that is too narrow or of another mesh.
    """
    halo = controls["halo"]
    if not isinstance(halo, Halo):
        raise ParameterError(f"is a {type(halo).__name__}; it must be the halo of a patch", parameter="halo")
    whole = halo.whole
    if len(whole.group) != len(mesh.vertices) or len(whole.flipped) != len(mesh.faces):
        raise ParameterError(
            f"belongs to a patch of {len(whole.group)} vertices and {len(whole.flipped)} faces; this mesh has "
            f"{len(mesh.vertices)} and {len(mesh.faces)}",
            parameter="halo",
            hint="pass the halo of the same patch",
        )
    rings = _rings(method, parameters, whole.groups)
    _check_local(controls)
    cut = mesh.topology.vertex_faces.counts != whole.around
    near = (steps_from(mesh.topology, cut, rings) < rings) & ~halo.vertices
    if near.any():
        raise ParameterError(
            f"is too narrow: {near.sum()} vertices are fewer than {rings} edges from the cut, which is the receptive "
            f"field of {method.name}",
            parameter="halo",
            hint=f"cut the patch with {rings} rings or more",
        )
    return halo


def _check_local(controls: Controls) -> None:
    """Refuse controls that see all of the mesh; raises ParameterError."""
    for name, setting in CONTROLS.items():
        given: Any = controls[name]  # type: ignore[literal-required]
        if name not in LOCAL_CONTROLS and given is not None and given != setting.default:
            raise ParameterError(
                "depends on the whole mesh", parameter=name, hint="leave it out, or denoise the mesh as a whole"
            )
    if controls["strength"] > 1:
        raise ParameterError(f"is {controls['strength']:g}; it must be at most 1 in a patch", parameter="strength")
    if controls["boundary"] == "smooth":
        raise ParameterError(
            "is 'smooth', which needs whole boundary loops; it must be 'free' or 'fixed' in a patch",
            parameter="boundary",
        )


def as_part(mesh: Mesh, whole: Whole) -> Mesh:
    """Return a patch as the method sees it: in the frame of the whole, and oriented as it is."""
    faces = mesh.faces.copy()
    faces[whole.flipped] = faces[whole.flipped, ::-1]
    framed = whole.frame.of(Mesh(mesh.vertices, faces))
    return framed.as_part(whole.group, mean_edge_length=whole.mean_edge_length)


def _rings(method: Method, parameters: Mapping[str, Any], groups: int) -> int:
    rings = method.receptive_field(parameters, groups)
    if rings is None:
        raise ParameterError(
            f"{method.name} depends on the whole mesh with these parameters: it solves a system of all vertices, or "
            "averages over all of them",
            hint="denoise it as a whole, or choose another method",
        )
    return rings
