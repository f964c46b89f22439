"""Denoise patches of a larger mesh with a halo around them.

With a wide enough halo, the interior of a patch gets the same result as in the whole mesh. A method depends only on a
few values of the whole mesh, which `Whole` holds, and on the mesh within its receptive field.
"""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from cascadenorm.api.regions.shells import shells
from cascadenorm.compute.csr import grouped
from cascadenorm.controls.weights import selected_vertices
from cascadenorm.errors import MeshError, ParameterError
from cascadenorm.geometry.neighborhoods import steps_from
from cascadenorm.geometry.orientation import oriented, with_flipped
from cascadenorm.io.interop import as_mesh
from cascadenorm.mesh import Bools, Ints, Ints32, Mesh, Topology, first_places, ordered_for_cache
from cascadenorm.mesh.frame import Frame, frame_of
from cascadenorm.mesh.isolation import repeats_vertex, without_lines, without_repeated_faces
from cascadenorm.mesh.mesh import checked_faces
from cascadenorm.registry import Method, find
from cascadenorm.registry.controls import CONTROLS, Controls

LOCAL_CONTROLS = ("strength", "mask", "fixed", "only", "boundary", "max_displacement", "threads", "progress", "halo")
"""Controls that depend on no more of the mesh than the method does."""


@dataclass(frozen=True, eq=False)
class Whole:
    """Properties of the whole mesh that its patches need.

    Parameters
    ----------
    frame
        Frame of the whole mesh.
    mean_edge_length
        Mean edge length in the frame.
    groups
        Number of groups in which the vertex update processes the vertices.
    group
        (n,) group of each vertex; -1 for unreferenced vertices.
    around
        (n,) number of faces around each vertex.
    flipped
        (m,) bool, faces to be flipped so that all are consistently oriented.
    """

    frame: Frame
    mean_edge_length: float
    groups: int
    group: Ints32
    around: Ints32
    flipped: Bools

    @classmethod
    def of(cls, mesh: Any, faces: ArrayLike | None = None) -> "Whole":
        """Gather these properties from a mesh.

        Parameters
        ----------
        mesh
            Mesh of any kind. If `faces` is given, the vertices (n, 3) alone.
        faces
            (m, 3) integers in 0 … n - 1, unless `mesh` holds them.

        Returns
        -------
        The properties, independent of the later positions of `mesh`.

        Raises
        ------
        MeshError
            The mesh is invalid, a face repeats a vertex or another face, or regions share walls and thus depend on each
            other.
        """
        mesh = as_mesh(mesh if faces is None else (mesh, faces))
        if without_lines(mesh) is not mesh:
            lines = repeats_vertex(mesh.faces)
            raise MeshError(
                f"{lines.sum()} faces repeat a vertex (faces {first_places(lines)})", hint="drop them first"
            )
        if (once := len(without_repeated_faces(mesh).faces)) < len(mesh.faces):
            raise MeshError(f"{len(mesh.faces) - once} faces repeat earlier ones", hint="drop them first")
        frame = frame_of(mesh)
        seen = frame.of(mesh)
        order = ordered_for_cache(seen)  # groups follow the order in which the whole is denoised
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
        """Return the number of edges around a vertex within which the mesh determines its position.

        Parameters
        ----------
        method
            Name of a method listed by `methods()`.
        parameters
            Parameters of the method.

        Returns
        -------
        Width of the halo that a patch needs, in edges.

        Raises
        ------
        ParameterError
            The position depends on the whole mesh.
        """
        return _receptive_field(find(method), parameters, self.groups)

    def patch(self, faces: ArrayLike, inside: ArrayLike, rings: int) -> "Patch":
        """Return a patch of this mesh with a halo of `rings` edges around it.

        Parameters
        ----------
        faces
            (m, 3) faces of the whole mesh.
        inside
            (n,) bool, or indices of the vertices of the patch.
        rings
            Width of the halo in edges, at least `receptive_field` of the method.

        Returns
        -------
        The patch: indices of its vertices in the whole mesh, its faces, and its halo.

        Raises
        ------
        MeshError
            The faces are not those of the whole mesh.
        ParameterError
            `inside` is neither one value per vertex nor indices of vertices.
        """
        every = checked_faces(faces, len(self.group))
        if len(every) != len(self.flipped):
            raise MeshError(f"there are {len(every)} faces; the whole mesh has {len(self.flipped)}: pass all")
        chosen = selected_vertices("inside", inside, len(self.group))
        near = steps_from(Topology(every, len(chosen)), chosen, rings) <= rings
        mine = near[every].all(axis=1)
        vertices = np.flatnonzero(near)
        numbers = np.cumsum(near, dtype=np.int32) - 1
        part = replace(self, group=self.group[vertices], around=self.around[vertices], flipped=self.flipped[mine])
        return Patch(vertices, numbers[every[mine]], Halo(~chosen[vertices], part))


@dataclass(frozen=True, eq=False)
class Halo:
    """The vertices of a patch that only provide context and do not move."""

    vertices: Bools  # (k,) which vertices of the patch
    whole: Whole  # properties of the whole mesh, with the rows of this patch


@dataclass(frozen=True, eq=False)
class Patch:
    """A part of a mesh."""

    vertices: Ints  # (k,) vertex indices in the whole mesh, ascending
    faces: Ints32  # (j, 3) indices into `vertices`
    halo: Halo  # to pass to `denoise`

    @property
    def inside(self) -> Ints:
        """Vertices of the whole mesh that are in the patch but not in its halo."""
        return self.vertices[~self.halo.vertices]


def check_halo(method: Method, parameters: Mapping[str, Any], mesh: Mesh, controls: Controls) -> Halo:
    """Return the halo of a patch; raise ParameterError if it does not suffice, or belongs to another mesh."""
    halo = controls["halo"]
    if not isinstance(halo, Halo):
        raise ParameterError(f"is of type {type(halo).__name__}; it must be the halo of a patch", parameter="halo")
    whole = halo.whole
    if len(whole.group) != len(mesh.vertices) or len(whole.flipped) != len(mesh.faces):
        raise ParameterError(
            f"belongs to a patch of {len(whole.group)} vertices and {len(whole.flipped)} faces; this mesh has "
            f"{len(mesh.vertices)} and {len(mesh.faces)}",
            parameter="halo",
            hint="pass the halo of the same patch",
        )
    rings = _receptive_field(method, parameters, whole.groups)
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
    """Raise ParameterError for controls that depend on the whole mesh."""
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


def in_frame_of_whole(mesh: Mesh, whole: Whole) -> Mesh:
    """Return a patch in the frame and the orientation of the whole mesh."""
    framed = whole.frame.of(with_flipped(mesh, whole.flipped))
    framed.topology.__dict__["vertex_colors"] = grouped(whole.group)
    return framed.with_facts(mean_edge_length=whole.mean_edge_length)


def _receptive_field(method: Method, parameters: Mapping[str, Any], groups: int) -> int:
    rings = method.receptive_field(parameters, groups)
    if rings is None:
        raise ParameterError(
            f"{method.name} depends on the whole mesh with these parameters: it solves a system of all vertices, or "
            "averages over all of them",
            hint="denoise it as a whole, or choose another method",
        )
    return rings
