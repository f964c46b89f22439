"""Denoise the data objects of VTK pipelines: a vtkPolyData, or a composite dataset whose blocks may share walls."""

from collections.abc import Iterator, Mapping
from typing import Any

from numpy.typing import NDArray
from vtkmodules.vtkCommonDataModel import vtkCompositeDataSet, vtkPolyData

from cascadenorm.api.api import denoise
from cascadenorm.api.regions.regions import denoise_regions
from cascadenorm.api.seamless import SeamlessMesh
from cascadenorm.api.selection import weights_of_attribute
from cascadenorm.errors import MeshError, ParameterError
from cascadenorm.io.polydata import vtk_array


def denoised(data: Any, settings: Mapping[str, Any]) -> Any:
    """Return a denoised copy of a vtkPolyData of triangles, or of a composite dataset, whose shared walls stay shared.

    Arrays are kept and normals recomputed. The settings are keyword arguments of `denoise`. For a single vtkPolyData,
    mask and fixed may be names of point arrays, only that of a cell array or array=value, and creases an angle as text.
    Raises MeshError or ParameterError as `denoise` does.
    """
    if isinstance(data, vtkPolyData):
        return denoise(data, **_with_arrays(settings, data))
    copy = data.NewInstance()
    copy.CopyStructure(data)
    copy.GetFieldData().DeepCopy(data.GetFieldData())
    isolate = settings.get("on_bad") == "isolate"
    moved = denoise_regions([_checked(place, isolate=isolate) for place in _blocks(data)], **settings)
    for place, block in zip(_blocks(data), moved, strict=True):
        copy.SetDataSet(place, block)
    return copy


def _blocks(data: Any) -> Iterator[Any]:
    """Yield the VTK iterator at each block that is not empty."""
    place = data.NewIterator()
    place.InitTraversal()
    while not place.IsDoneWithTraversal():
        yield place
        place.GoToNextItem()


def _checked(place: Any, *, isolate: bool) -> Any:
    """Return the block at a place; errors begin with its name."""
    block = place.GetCurrentDataObject()
    try:
        SeamlessMesh.of(block, isolate=isolate)
    except MeshError as error:
        name = place.GetCurrentMetaData().Get(vtkCompositeDataSet.NAME()) if place.HasCurrentMetaData() else None
        raise error.within(name or f"block {place.GetCurrentFlatIndex()}") from None
    return block


def _with_arrays(settings: Mapping[str, Any], mesh: Any) -> dict[str, Any]:
    """Return settings in which names of arrays are replaced by the arrays of the mesh."""
    found = dict(settings)
    points, cells = mesh.GetPointData(), mesh.GetCellData()
    if isinstance(mask := found.get("mask"), str):
        found["mask"] = weights_of_attribute(_array("mask", mask, points))
    if isinstance(fixed := found.get("fixed"), str):
        found["fixed"] = _array("fixed", fixed, points) != 0
    if isinstance(only := found.get("only"), str):
        array, equals, value = only.partition("=")
        values = _array("only", array, cells)[mesh.GetNumberOfVerts() + mesh.GetNumberOfLines() :]  # of the triangles
        found["only"] = values == _number("only", value) if equals else values != 0
        if not found["only"].any():
            raise ParameterError(f"matches no cell with {only!r}", parameter="only")
    if isinstance(creases := found.get("creases"), str):
        found["creases"] = _number("creases", creases)
    return found


def _array(setting: str, name: str, data: Any) -> NDArray[Any]:
    array = data.GetArray(name)
    if array is None:
        known = [data.GetArrayName(i) for i in range(data.GetNumberOfArrays())]
        raise ParameterError(
            f"is {name!r}, which is not an array of the {'cells' if setting == 'only' else 'points'}; "
            f"there are: {', '.join(filter(None, known)) or 'none'}",
            parameter=setting,
        )
    return vtk_array(array)


def _number(setting: str, text: str) -> float:
    try:
        return float(text)
    except ValueError:
        raise ParameterError(f"is {text!r}; it must be a number", parameter=setting) from None
