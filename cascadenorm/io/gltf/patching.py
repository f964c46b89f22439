"""Add patches that close holes to a glTF document, as primitives with values of their surroundings."""

import copy
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from cascadenorm.io.gltf.accessors import COMPONENT_TYPES, FLOAT, Accessors, NewAccessors, Primitive, storable
from cascadenorm.io.hole_patches import HolePatches

COMPRESSED_IN = ("KHR_draco_mesh_compression",)
COPIED = ("JOINTS_", "WEIGHTS_", "TANGENT")
"""Attributes that are copied from the nearest vertex, since their means would not be valid."""


class AttributeKey(NamedTuple):
    """An attribute of a primitive, and how it is stored."""

    name: str
    target: int  # number of its morph target; -1 for none
    component: int  # type of its numbers in glTF
    type: str
    normalized: bool


class PatchedDocument:
    """The additions to a document for patches.

    `document` gets the primitives and materials of the patches, and `added` their accessors. The primitives of the file
    are given in the order of its polygons, with the `rows` of their vertices in its positions, and its normals as
    (k, 3), zero where it has none. `untextured` counts the patches without texture, since they cross a seam of the
    texture coordinates.
    """

    def __init__(
        self,
        document: dict[str, Any],
        accessors: Accessors,
        primitives: list[Primitive],
        rows: list[NDArray[np.int64]],
        positions: NDArray[Any],
        welds: NDArray[np.int32],
        normals: NDArray[np.float64],
        patches: HolePatches,
        added: NewAccessors,
    ) -> None:
        self._document, self._accessors, self._places, self._patches = document, accessors, primitives, patches
        self._rows, self._positions, self._welds, self._count = rows, positions, welds, len(positions)
        self._materials, self._added, self.untextured = list(document.get("materials", [])), added, 0
        self._normals = patches.all_normals(normals)
        owners = np.repeat(np.arange(len(rows)), [len(place.triangles) for place in primitives])[patches.polygons]
        found = [self._part(patches.parts == n, owners) for n in range(int(patches.parts.max(initial=-1)) + 1)]
        further = self._blended(found)
        of_meshes: dict[int, list[Any]] = {}
        for part in found:
            mesh = primitives[part.place].mesh
            of_mesh = of_meshes.setdefault(mesh, list(document["meshes"][mesh]["primitives"]))
            of_mesh.append(self._primitive(part, further))
        meshes = [
            mesh | ({"primitives": of_meshes[number]} if number in of_meshes else {})
            for number, mesh in enumerate(document["meshes"])
        ]
        lists = {"accessors": added.accessors, "bufferViews": added.views, "materials": self._materials}
        lists = {name: values for name, values in lists.items() if values and name in document}
        self.document = {**document, "meshes": meshes, **lists}

    def _part(self, chosen: NDArray[np.bool_], owners: NDArray[np.int64]) -> "_Part":
        """Return one patch. It is assigned to the primitive that owns most of its nearest faces."""
        number = int(np.bincount(owners[chosen]).argmax())
        rows = self._rows[number]
        vertices, corners = np.unique(self._patches.triangles[chosen], return_inverse=True)
        own = vertices[vertices < self._count]
        order = np.argsort(self._welds[rows], kind="stable")
        sorted_welds = self._welds[rows][order]
        first, last = (np.searchsorted(sorted_welds, self._welds[own], side) for side in ("left", "right"))
        local = np.where(last > first, order[np.minimum(first, len(order) - 1)], -1)
        part = _Part(number, vertices, own, corners.reshape(-1, 3), local, {}, [])
        for key, accessor in self._attributes(number).items():
            values = self._accessors.values(accessor)
            usual = values[local[local >= 0][:1]] if (local >= 0).any() else values[:1]
            part.values[key] = np.where((local >= 0)[:, None], values[local], usual)
            if key.name.startswith("TEXCOORD_") and key.target < 0:
                copies = [values[order[a:b]] for a, b in zip(first.tolist(), last.tolist(), strict=True)]
                if any(not len(found) or (found != found[0]).any() for found in copies):
                    part.seams.append(key.name)
        return part

    def _attributes(self, number: int) -> dict[AttributeKey, int]:
        """Return the accessors of a primitive except positions and normals, and those of its morph targets."""
        place = self._places[number]
        primitive = self._document["meshes"][place.mesh]["primitives"][place.number]
        plain = {name: a for name, a in primitive["attributes"].items() if name not in ("POSITION", "NORMAL")}
        found: dict[AttributeKey, int] = {}
        for target, attributes in enumerate([plain, *primitive.get("targets", [])], -1):
            for name, accessor in attributes.items():
                declared = self._document["accessors"][accessor]
                stored = declared["componentType"], declared["type"], bool(declared.get("normalized"))
                found[AttributeKey(name, target, *stored)] = accessor
        return found

    def _blended(self, parts: list["_Part"]) -> dict[AttributeKey, NDArray[np.float64]]:
        """Return the values of additional vertices, (a, w), by attribute."""
        known: dict[AttributeKey, NDArray[np.float64]] = {}
        for part in parts:
            for key, values in part.values.items():
                table = known.setdefault(key, np.zeros((self._count, values.shape[1])))
                table[part.own] = values
        found = {}
        for key, table in known.items():
            whole = key.component != FLOAT and not key.normalized
            fill = self._patches.nearest if whole or key.name.startswith(COPIED) else self._patches.blended
            found[key] = np.stack([fill(column) for column in table.T], axis=1)
        return found

    def _primitive(self, part: "_Part", further: dict[AttributeKey, NDArray[np.float64]]) -> dict[str, Any]:
        """Return the primitive of a patch, and add its accessors."""
        place = self._places[part.place]
        like = self._document["meshes"][place.mesh]["primitives"][place.number]
        new = part.vertices[len(part.own) :] - self._count
        storage, positions = self._accessors.storage(like["attributes"]["POSITION"]), self._patches.positions[new]
        stored = storable(np.concatenate([self._positions[part.own], positions]), *storage)
        number = self._added.add(stored, normalized=storage[1] > 1, bounds=True)
        made: dict[str, Any] = {"attributes": {"POSITION": number}}
        if "NORMAL" in like["attributes"]:
            self._add_normals(made["attributes"], part, new, like["attributes"]["NORMAL"])
        targets: list[dict[str, int]] = [{} for _ in like.get("targets", [])]
        for key, values in part.values.items():
            kind = np.dtype(COMPONENT_TYPES[key.component])
            filled = further[key][new]
            if kind.kind != "f":
                filled = np.clip(np.rint(filled), np.iinfo(kind).min, np.iinfo(kind).max)
            number = self._added.add(
                np.concatenate([values.astype(kind), filled.astype(kind)]),
                normalized=key.normalized,
                bounds=key.target >= 0 and key.name == "POSITION",
            )
            (targets[key.target] if key.target >= 0 else made["attributes"])[key.name] = number
        made["indices"] = self._added.add(part.corners.astype("<u4").reshape(-1, 1), indices=True)
        if targets:
            made["targets"] = targets
        kept = {key: value for key, value in like.items() if key not in ("mode", "extensions", *made)}
        extensions = {name: value for name, value in like.get("extensions", {}).items() if name not in COMPRESSED_IN}
        made |= kept | ({"extensions": extensions} if extensions else {})
        if "material" in made and part.seams:
            made["material"] = self._untextured(made["material"])
        return made

    def _add_normals(self, attributes: dict[str, int], part: "_Part", new: NDArray[np.int64], accessor: int) -> None:
        """Add the normals of a patch: stored ones at the boundary, computed ones inside."""
        stored = self._accessors.fractions(accessor)
        if stored is None or stored.shape[1] != 3:
            return
        own = np.where((part.local >= 0)[:, None], stored[part.local], self._normals[part.own])
        normals = np.concatenate([own, self._normals[self._count + new]]).astype("<f4")
        attributes["NORMAL"] = self._added.add(normals)

    def _untextured(self, number: int) -> int:
        """Add a copy of a material without its textures; return its number."""
        self.untextured += 1
        material = _without_textures(copy.deepcopy(self._materials[number]))
        if material in self._materials:
            return self._materials.index(material)
        self._materials.append(material)
        return len(self._materials) - 1


class _Part(NamedTuple):
    place: int  # number of the primitive whose properties it gets
    vertices: NDArray[np.int64]  # ascending positions, those of the file before additional ones
    own: NDArray[np.int64]  # those of the file only
    corners: NDArray[np.int64]  # (b, 3) rows of `vertices`
    local: NDArray[np.int64]  # for each of `own` the vertex of the primitive; -1 if there is none
    values: dict[AttributeKey, NDArray[Any]]  # values of `own`, by attribute
    seams: list[str]  # names of texture coordinates for which a vertex has several values, or none


def _without_textures(value: Any) -> Any:
    """Return a material without textures at any depth."""
    if not isinstance(value, dict):
        return value
    return {name: _without_textures(inner) for name, inner in value.items() if not name.lower().endswith("texture")}
