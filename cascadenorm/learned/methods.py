"""The learned methods `auto` and `cascade`, and the shipped weights."""

from dataclasses import dataclass
from functools import cache
from importlib import resources
from os import PathLike
from pathlib import Path
from typing import Annotated, Literal

import numpy as np

from cascadenorm.baselines.wide_errors import wide_on_components
from cascadenorm.detection.gate import Treatment
from cascadenorm.detection.segmentation_steps import without_voxel_faces
from cascadenorm.detection.spikes import impulsive, without_outliers
from cascadenorm.detection.steps import enlarged_steps
from cascadenorm.geometry.patches.work import free_derived
from cascadenorm.learned.cascade import Cascade
from cascadenorm.learned.gated import ChosenNetworks, GatedCascades, read_model
from cascadenorm.learned.safeguards import safeguarded
from cascadenorm.learned.surface_filter import with_filtered_surfaces
from cascadenorm.mesh import Bools, Mesh, Vectors
from cascadenorm.mesh.averages import averaged
from cascadenorm.registry import Parameter, ParameterError, method

SHIPPED = ("auto", "cascade")
"""The methods that use weights, which are also the names of the weights that ship with the package."""
DRIFT_PASSES = 64  # averages of displacements with those of the neighbours, which leave the drift

Learned = Cascade | GatedCascades
Model = Annotated[
    Learned | Path | None, Parameter("Weights file written by `cascadenorm train`. Default: the shipped weights")
]
TreatAs = Annotated[
    Treatment | None,
    Parameter(
        "Kind of surface to assume; unknown omits the final filter of measured surfaces. Default: detected for each "
        "component"
    ),
]


@method("auto", source="after Wang, Liu, Tong 2016", family="learned", converges=True)
def auto(mesh: Mesh, *, model: Model = None, treat_as: TreatAs = None) -> Vectors:
    """Regress face normals with trained networks and fit the vertices to them, in three stages.

    The inputs of the networks are normals after iterated bilateral filters and normals of smoothed vertices. There are
    two networks: one trained on vertex noise, the other on the errors of volumes, scanners, cameras and point clouds.
    For each connected component, a gate chooses between them from the triangulation. Where it denies a measurement and
    the first network finds hardly any noise, a second gate decides by what the other network would remove. Strong
    vertex noise has its own later stages. Measured surfaces are then filtered bilaterally, and their boundaries also
    fitted by quadrics, unless `treat_as` is `unknown`.

    Formula
    -------
    n_f ← unit Σ_i c_i(d_f) n_i,f;   n_i: iterated bilateral filters and normals of smoothed vertices
    d_f: log(1 - <n_i, n_j> + 1e-4) for pairs of them, and context;   c: a network for each stage
    then the vertices are updated, and the next stage starts from them

    Limits
    ------
    Relief that is smooth at the scale of the edges counts as shape, unless a gate recognises a measured surface.
    Segmentations with thick slices and noise that folds faces over remain difficult. The networks were trained on
    generated shapes, so kinds of error that were not simulated may remain.
    """
    noisy, mesh = mesh, without_outliers(mesh)
    network: Learned | ChosenNetworks = loaded(model, "auto")
    if isinstance(network, GatedCascades):
        measured = network.component_kinds(mesh, treat_as).measured
        network = network.chosen(measured, impulsive(noisy, mesh))
    if noisy is not mesh:
        noisy.forget_geometry()  # the networks need memory
    return denoised(mesh, network, filtered=treat_as != "unknown")


def denoised(mesh: Mesh, network: Cascade | ChosenNetworks, *, filtered: bool = True) -> Vectors:
    """Denoise a mesh without spikes with one network, or with the network chosen for each component.

    Returns the vertices, (n, 3), after all other steps of `auto`. `filtered` selects the filter of measured surfaces.
    """
    start = without_voxel_faces(mesh)
    free_derived(mesh)
    mesh.topology.forget_adjacent_faces()
    vertices = network.vertices(start)
    del start
    measured = network.measured[mesh.topology.face_components] if isinstance(network, ChosenNetworks) else None
    if measured is not None and filtered:
        vertices = with_filtered_surfaces(mesh, vertices, measured)
    vertices = without_drift(mesh, vertices)
    free_derived(mesh)
    return safeguarded(mesh, vertices, measured)


def without_drift(mesh: Mesh, vertices: Vectors) -> Vectors:
    """Remove the smooth part of the displacement from a mesh to its denoised vertices, (n, 3), along the normals.

    Normals determine vertices only up to slow variations, so the vertex update leaves such errors. Noise has hardly any
    low-frequency part: the mean of a displacement over many vertices is drift. It is estimated by averaging each vertex
    with its neighbours DRIFT_PASSES times, which keeps wavelengths above about ten edges. Returns (n, 3) vertices;
    those without a face, and those that have not moved, keep the given position.
    """
    normals = mesh.moved(vertices).vertex_normals
    drift = np.einsum("ij,ij->i", vertices - mesh.vertices, normals)
    drift = averaged(drift, mesh.topology.vertex_neighbors, DRIFT_PASSES)
    drift[(vertices == mesh.vertices).all(axis=1)] = 0
    return np.asarray(vertices - drift[:, None] * normals)


@method("cascade", source="Wang, Liu, Tong 2016", family="learned")
def cascade(mesh: Mesh, *, model: Model = None) -> Vectors:
    """Regress face normals from B-FND and G-FND and move the vertices to fit them, in three stages.

    Formula
    -------
    n_f ← unit Σ_i c_i(d_f) n_i,f;   n_i: B-FND, G-FND, σ_s = 1, 2 and σ_r = 0.1, 0.2, 0.35, 0.5, ∞
    d_f: log(1 - <n_i, n_j> + 1e-4) for all pairs;   c: a network for each of four clusters
    then the vertices are updated, and the next stage starts from them

    Limits
    ------
    The filters have a radius of five mean edge lengths. Heavy noise and errors that are correlated over many edges
    therefore remain in part. The vertex update may fold faces over.
    """
    return loaded(model, "cascade").vertices(mesh)


def weights_file(name: str, model: str | Path | None = None) -> Path:
    """Return the weights file of a learned method: the given one, or the shipped one."""
    if model is not None:
        return Path(model)
    return Path(str(resources.files("cascadenorm"))) / "weights" / f"{name}.safetensors"


@cache
def shipped(name: str) -> Learned:
    """Return a shipped model, "auto" or "cascade"."""
    return read_model(weights_file(name))


def loaded(model: Learned | Path | None, name: str) -> Learned:
    """Return the networks of a learned method: the given model, or the shipped one."""
    if isinstance(model, Learned):
        return model
    if not isinstance(model, str | PathLike | None):
        raise ParameterError(
            f"model is of type {type(model).__name__}; it must be the path of a file that `train` made"
        )
    return shipped(name) if model is None else read_model(model)


@dataclass(frozen=True, kw_only=True)
class MeshTreatment:
    """How `auto` treats a mesh."""

    # of most of the faces; `enlarged-volume` for components of which coarse copies are denoised
    treatment: Treatment | Literal["enlarged-volume"]
    probability: float  # of this treatment according to the gate, averaged over those faces
    share: float  # of the faces with this treatment; other components get other treatments
    given: bool = False  # whether `treat_as`, creases or coarse copies determined it instead of the gate

    def __str__(self) -> str:
        """Return a phrase, such as "measured surface (probability 0.93)"."""
        name = self.treatment.replace("-", " ")
        if self.given:  # `unknown` may follow from creases or coarse copies without being set
            return name if self.treatment == "unknown" else f"{name} (as set)"
        share = "" if self.share == 1 else f", {int(100 * self.share)}% of the faces"  # 99.8 % are not all
        return f"{name} (probability {self.probability:.2f}{share})"


def mesh_treatment(
    mesh: Mesh, *, width: float | None = None, model: Model = None, treat_as: TreatAs = None
) -> MeshTreatment | None:
    """Return how `auto` treats a mesh without repeated faces, or None for a model without a gate.

    Components on which errors of the width, in mesh units, are wide are denoised on coarse copies, as an unknown
    surface. If the width is None, those that have the steps of enlarged volumes are.
    """
    network = loaded(model, "auto")
    if not isinstance(network, GatedCascades):
        return None
    kinds = network.component_kinds(mesh, treat_as)
    components = mesh.topology.face_components
    measured = kinds.measured[components]
    copied = np.zeros_like(measured)
    if treat_as is None:
        copied = (enlarged_steps(mesh) if width is None else wide_on_components(mesh, width))[components] > 0
    faces: dict[Treatment | Literal["enlarged-volume"], Bools] = {
        "measured-surface": measured & ~copied,
        "vertex-noise": ~measured & ~copied,
        "enlarged-volume" if width is None else "unknown": copied,
    }
    most = max(faces, key=lambda treatment: np.count_nonzero(faces[treatment]))
    mean = float(kinds.probabilities[components][faces[most]].mean())
    return MeshTreatment(
        treatment=treat_as or most,
        probability={"measured-surface": mean, "vertex-noise": 1 - mean}.get(most, 1.0),
        share=float(np.mean(faces[most])),
        given=treat_as is not None or most == "unknown",
    )
