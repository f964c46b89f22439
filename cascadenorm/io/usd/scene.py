"""Convert a USD scene to one mesh and a mesh to a scene."""

import tempfile
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from cascadenorm.errors import ReadError
from cascadenorm.io.content import CHANNELS, TEXTURE, Content, Look, with_distinct_names
from cascadenorm.io.libraries import explained
from cascadenorm.io.limits import check_expansion
from cascadenorm.io.shown import joined, placed
from cascadenorm.io.usd.layers import Layers, quiet, target, without_files_outside
from cascadenorm.io.usd.meshes import oriented_polygons, values_of

KEPT_ELSEWHERE = {
    "Material": "materials",
    "Camera": "cameras",
    "SkelAnimation": "animations",
    "Points": "points",
    "BasisCurves": "curves",
    "PointInstancer": "instances of points",
}
METADATA = {"upAxis": "the up axis", "metersPerUnit": "the unit"}
PRIM = 1000  # approximate memory in bytes of a composed prim


def scene_content(layers: Layers, size: int) -> Content:
    """Return the meshes that a scene shows, whose root is the first layer, reading nothing else; `size` is in bytes."""
    from pxr import Usd

    inside, outside = without_files_outside(layers)
    root = next(iter(inside))
    check_expansion(PRIM * _Composition(inside).count(root, "/"), size, "the objects of this scene")
    composing = explained("OpenUSD cannot compose the scene of this file")
    with quiet(), tempfile.TemporaryDirectory(ignore_cleanup_errors=True) as folder, composing:
        if len(inside) == 1:
            stage = Usd.Stage.Open(inside[root])
        else:
            for name, layer in inside.items():
                path = Path(folder) / name
                path.parent.mkdir(parents=True, exist_ok=True)
                layer.Export(str(path))
            stage = Usd.Stage.Open(str(Path(folder) / root))
        content = _content(stage, size)
        del stage
    lost = (f"the file {path!r} that it references" for path in outside)
    return replace(content, left_out=(*lost, *content.left_out))


def _content(stage: Any, size: int) -> Content:
    from pxr import Usd, UsdGeom

    cache = UsdGeom.XformCache()
    everything = list(stage.Traverse(Usd.TraverseInstanceProxies(Usd.PrimDefaultPredicate)))
    meshes = [prim for prim in everything if prim.IsA(UsdGeom.Mesh)]
    prims = _visible(meshes) or meshes  # all if the scene shows none
    shown: list[Content] = []
    taken = 0
    for prim in prims:
        mesh = _shown(UsdGeom.Mesh(prim), np.array(cache.GetLocalToWorldTransform(prim), float))
        taken += mesh.positions.nbytes + mesh.polygons.corners.nbytes
        check_expansion(taken, size, "the meshes that the scene of this file shows")
        shown.append(mesh)
    kinds = {str(prim.GetTypeName()) for prim in everything}
    left_out = [what for kind, what in KEPT_ELSEWHERE.items() if kind in kinds]
    left_out += ["meshes that the scene does not show"] if len(prims) < len(meshes) else []
    left_out += [what for name, what in METADATA.items() if stage.HasAuthoredMetadata(name)]
    whole = joined(shown)
    return replace(whole, left_out=(*left_out, *_lost_values(prims, {*whole.vertex_values, *whole.face_values})))


def _lost_values(prims: list[Any], kept: set[str]) -> list[str]:
    """Return the normals and primvars of meshes that are not among the kept values, in words."""
    from pxr import UsdGeom

    names = {p.GetPrimvarName() for prim in prims for p in UsdGeom.PrimvarsAPI(prim).GetPrimvarsWithValues()}
    normals = "normals" in names or any(UsdGeom.Mesh(prim).GetNormalsAttr().HasAuthoredValue() for prim in prims)
    stored = {"displayColor": CHANNELS[0], "st": TEXTURE[0]}
    lost = sorted(name for name in names - {"normals"} if stored.get(name, name) not in kept)
    return (["normals"] if normals else []) + [f"the primvar {name!r}" for name in lost]


def _visible(meshes: list[Any]) -> list[Any]:
    """Return the meshes that a rendered picture shows: visible ones, but no guides, and no proxies of others."""
    from pxr import Usd, UsdGeom

    time = Usd.TimeCode.EarliestTime()
    purposes = [UsdGeom.Imageable(prim).ComputePurpose() for prim in meshes]
    hidden = {"guide", "proxy"} if "render" in purposes else {"guide"}
    return [
        prim
        for prim, purpose in zip(meshes, purposes, strict=True)
        if purpose not in hidden and UsdGeom.Imageable(prim).ComputeVisibility(time) != "invisible"
    ]


def _shown(mesh: Any, matrix: NDArray[np.float64]) -> Content:
    """Return a mesh transformed by its matrix, which applies to row vectors."""
    from pxr import Usd, UsdGeom

    time, path = Usd.TimeCode.EarliestTime(), str(mesh.GetPath())
    points, counts, corners = (
        np.asarray([] if (found := attribute.Get(time)) is None else found)
        for attribute in (mesh.GetPointsAttr(), mesh.GetFaceVertexCountsAttr(), mesh.GetFaceVertexIndicesAttr())
    )
    points = points.reshape(-1, 3) if points.size % 3 == 0 else np.zeros((0, 3), np.float32)
    reverses = mesh.GetOrientationAttr().Get(time) == "leftHanded"
    polygons, places = oriented_polygons(counts, corners, reverses, path)
    primvars = (
        (str(primvar.GetPrimvarName()), primvar.GetInterpolation(), primvar.ComputeFlattened(time))
        for primvar in UsdGeom.PrimvarsAPI(mesh).GetPrimvarsWithValues()
    )
    vertex_values, face_values = values_of(primvars, len(points), polygons, places)
    content = Content(points, polygons, vertex_values, face_values)
    holes = mesh.GetHoleIndicesAttr().Get(time)
    if holes:
        content = content.with_polygons(~np.isin(np.arange(len(polygons)), np.asarray(holes)))
    return placed(content, matrix.T)


class _Composition:
    """Upper bound on the number of prims of a composed scene. It rejects scenes that expand without limit."""

    def __init__(self, layers: Layers) -> None:
        self._layers, self._known = layers, dict[tuple[str, str], int]()

    def count(self, name: str, path: Any) -> int:
        """Return the number of prims at and below a path of a layer, including all that they reference."""
        key = (name, str(path))
        if key not in self._known:
            self._known[key] = 0  # for a cycle back to here, which OpenUSD ignores
            try:
                self._known[key] = self._counted(name, path)
            except RecursionError:
                raise ReadError("the objects of this scene are nested too deeply: export the file again") from None
        return self._known[key]

    def _counted(self, name: str, path: Any) -> int:
        from pxr import Sdf

        layer, place = self._layers[name], Sdf.Path(path)
        if place == Sdf.Path.absoluteRootPath:
            total = sum(self.count(name, prim.path) for prim in layer.rootPrims)
            sublayers = (target(path, name, self._layers) for path in layer.subLayerPaths)
            return total + sum(self.count(found, "/") for found in sublayers if found is not None)
        prim = layer.GetPrimAtPath(place)
        if prim is None:  # the prim may come from composition, so count from its parent
            return self.count(name, place.GetParentPath())
        total = 1 + sum(self.count(name, child.path) for child in prim.nameChildren)
        for sets in prim.variantSets:
            total += sum(self.count(name, variant.primSpec.path) for variant in sets.variants)
        for arcs in (prim.referenceList, prim.payloadList):
            for arc in arcs.GetAddedOrExplicitItems():
                found = target(arc.assetPath, name, self._layers) if arc.assetPath else name
                if found is not None:
                    total += self.count(found, arc.primPath or "/")
        for paths in (prim.inheritPathList, prim.specializesList):
            total += sum(self.count(name, at) for at in paths.GetAddedOrExplicitItems())
        return total


def stage_of(content: Content) -> tuple[Any, list[str]]:
    """Return a layer with one mesh, its colours, texture coordinates and other values, and what is lost."""
    from pxr import Sdf, Tf, Usd, UsdGeom, Vt

    positions = content.single_positions()
    layer = Sdf.Layer.CreateAnonymous(".usda")
    stage = Usd.Stage.Open(layer)
    mesh = UsdGeom.Mesh.Define(stage, "/mesh")
    stage.SetDefaultPrim(mesh.GetPrim())
    mesh.CreatePointsAttr(Vt.Vec3fArray.FromNumpy(np.ascontiguousarray(positions)))
    mesh.CreateFaceVertexCountsAttr(Vt.IntArray.FromNumpy(content.polygons.counts.astype(np.int32)))
    mesh.CreateFaceVertexIndicesAttr(Vt.IntArray.FromNumpy(content.polygons.corners.astype(np.int32)))
    mesh.CreateSubdivisionSchemeAttr("none")
    finite = positions[np.isfinite(positions).all(axis=1)]
    if len(finite):
        mesh.CreateExtentAttr(Vt.Vec3fArray.FromNumpy(np.stack([finite.min(axis=0), finite.max(axis=0)])))
    api, names = UsdGeom.PrimvarsAPI(mesh), Sdf.ValueTypeNames
    look = Look.of(content.vertex_values)
    if look.colors is not None:
        api.CreatePrimvar("displayColor", names.Color3fArray, "vertex").Set(Vt.Vec3fArray.FromNumpy(look.colors))
    if look.texture is not None:
        st = look.texture.astype(np.float32)
        api.CreatePrimvar("st", names.TexCoord2fArray, "vertex").Set(Vt.Vec2fArray.FromNumpy(st))
    others = {name: column for name, column in content.vertex_values.items() if name not in look.names}
    types, taken = {"f4": "FloatArray", "f8": "DoubleArray", "i8": "Int64Array"}, {"displayColor", "st"}
    for properties, kind in ((others, "vertex"), (content.face_values, "uniform")):
        for name, column in with_distinct_names(properties, Tf.MakeValidIdentifier, taken).items():
            taken.add(name)
            wide = "f4" if column.dtype == np.float32 else "f8" if column.dtype.kind == "f" else "i8"
            primvar = api.CreatePrimvar(name, getattr(names, types[wide]), kind)
            primvar.Set(getattr(Vt, types[wide]).FromNumpy(np.ascontiguousarray(column, wide)))
    lost = ["digits of the positions beyond single precision"] if (positions != content.positions).any() else []
    return layer, lost
