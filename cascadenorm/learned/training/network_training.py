"""Train the network of one cluster."""

from collections.abc import Callable, Mapping, Sequence
from itertools import pairwise
from typing import NamedTuple

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor
from torch.nn.parallel import DistributedDataParallel

from cascadenorm.learned.config import ConfigError, Fit
from cascadenorm.learned.features import FLOOR, Array, FeatureScaler
from cascadenorm.learned.stage import Activation
from cascadenorm.learned.training import distributed
from cascadenorm.mesh import limit_threads

GPU_MEMORY_FRACTION = 0.8  # largest share of the free GPU memory that training faces may occupy


class TrainingFaces(NamedTuple):
    """Training faces: filtered normals (m, k, 3), context (m, c), true normals (m, 3), in single precision."""

    stack: Tensor
    context: Tensor
    truth: Tensor

    def placed(self) -> "TrainingFaces":
        """Return the faces on the device of the matrix products if they fit into its memory."""
        device, size = distributed.device(), sum(tensor.nbytes for tensor in self)
        if device.type == "cuda" and size > GPU_MEMORY_FRACTION * torch.cuda.mem_get_info(device)[0]:
            return self
        return TrainingFaces(*(tensor.to(device) for tensor in self))


class Network(torch.nn.Module):
    """Hidden layers that map the features of a face to one coefficient per filtered normal."""

    def __init__(self, widths: Sequence[int], activation: Activation, generator: torch.Generator) -> None:
        super().__init__()
        functions: dict[Activation, Callable[[Tensor], Tensor]] = {"silu": torch.nn.functional.silu, "tanh": torch.tanh}
        self.activation = functions[activation]
        layers = [torch.nn.Linear(i, o) for i, o in pairwise(widths)]
        for layer in layers:
            bound = layer.in_features**-0.5
            torch.nn.init.uniform_(layer.weight, -bound, bound, generator=generator)
            torch.nn.init.zeros_(layer.bias)
        torch.nn.init.constant_(layers[-1].bias, 1 / widths[-1])  # training starts near the mean of the normals
        self.layers = torch.nn.ModuleList(layers)

    def forward(self, features: Tensor, stack: Tensor) -> Tensor:
        """Return unit normals, (m, 3)."""
        for layer in self.layers[:-1]:
            features = self.activation(layer(features))
        coefficients = self.layers[-1](features)
        return torch.nn.functional.normalize((coefficients[:, :, None] * stack).sum(dim=1), dim=1)


def torch_features(scaler: FeatureScaler, device: torch.device) -> Callable[[Tensor, Tensor], Tensor]:
    """Return a function that computes `FeatureScaler.features` in torch."""
    first, second = torch.tensor(scaler.pairs.T.astype(int), device=device)
    mean, scale, context_mean, context_scale = (
        torch.tensor(array, device=device)
        for array in (scaler.mean, scaler.scale, scaler.context_mean, scaler.context_scale)
    )

    def features(stack: Tensor, context: Tensor) -> Tensor:
        axes = stack.transpose(1, 2).contiguous()
        x, y, z = (axes.index_select(2, first) - axes.index_select(2, second)).square_().unbind(dim=1)
        own = ((0.5 * (x + y + z) + FLOOR).log_() - mean).mul_(scale)
        return torch.cat([own, (context - context_mean) * context_scale], dim=1)

    return features


def features_on(device: torch.device, scaler: FeatureScaler) -> Callable[[Tensor, Tensor], Tensor]:
    """Return a function that maps filtered normals and context to features, on the given device.

    On the CPU this is `FeatureScaler.features`, otherwise its torch version.
    """
    if device.type != "cpu":
        return torch_features(scaler, device)

    def kernel(stack: Tensor, context: Tensor) -> Tensor:
        with limit_threads(1):
            return torch.from_numpy(scaler.features(stack.numpy(), context.numpy()))

    return kernel


def chordal_distance(predicted: Tensor, truth: Tensor) -> Tensor:
    """Return the distances between unit normals. Squared distances would be dominated by outliers."""
    return torch.sqrt(((predicted - truth) ** 2).sum(dim=1) + 1e-8)


def angle_sum(chord: Tensor) -> float:
    """Sum the angles of chords, in degrees."""
    return torch.rad2deg(2 * torch.asin((chord.double() / 2).clamp(max=1))).sum().item()


def _batches(own: int, batch: int) -> tuple[list[int], list[int]]:
    """Return the numbers of faces that this process, and that all processes, contribute to each batch of an epoch."""
    counts = distributed.all_gather(np.array([own]))
    whole = int(counts.sum())
    stops = np.minimum(np.arange(0, whole + batch, batch), whole)
    given = np.diff(counts[:, None] * stops // whole)
    return given[distributed.rank()].tolist(), np.maximum(given.sum(axis=0), 1).tolist()


def train_network(
    faces: TrainingFaces,
    rows: NDArray[np.intp],
    scaler: FeatureScaler,
    fit: Fit,
    activation: Activation,
    *,
    seed: int,
    log: Callable[[int, float, float, float], None] = lambda *_: None,
) -> dict[str, Array]:
    """Train a network on 85 % of some faces with early stopping on the other 15 %, and return the best weights.

    `faces` are those of all clusters on this process, `rows` those of one cluster, and the scaler is that of their
    features. At least one process has some. Several processes average their gradients. Each contributes to a batch in
    proportion to its number of faces. The seed determines the split, the initial weights and the order of the batches.
    `log` is called after each epoch with its number from 1, the training loss, the validation loss, and the mean
    validation angle in degrees. Returns weight1 (d, h), bias1 (h,) and so on up to the k coefficients, and validation
    (), the loss on the 15 %.
    """
    generator = torch.Generator().manual_seed(seed)
    device, stored = distributed.device(), faces.stack.device
    training, validation = _split(rows, generator)
    features, inputs = features_on(device, scaler), len(scaler.mean) + faces.context.shape[1]
    network = Network([inputs, *fit.hidden, faces.stack.shape[1]], activation, generator).to(device)
    model = DistributedDataParallel(network) if distributed.world_size() > 1 else network
    optimiser = torch.optim.AdamW(
        network.parameters(), lr=fit.learning_rate, weight_decay=fit.weight_decay, fused=device.type == "cuda"
    )
    mine, sizes = _batches(len(training), fit.batch)
    schedule = torch.optim.lr_scheduler.CosineAnnealingLR(optimiser, fit.epochs * len(sizes))

    def chords_of(model: torch.nn.Module, part: Tensor) -> Tensor:
        stack, context, truth = (tensor[part].to(device) for tensor in faces)
        return chordal_distance(model(features(stack, context), stack), truth)

    best, best_loss, best_epoch = network.state_dict(), np.inf, 0
    for epoch in range(1, fit.epochs + 1):
        drawn = training[torch.randperm(len(training), generator=generator)].to(stored)
        learned = torch.zeros((), dtype=torch.float64, device=device)
        for part, size in zip(drawn.split(mine), sizes, strict=True):  # type: ignore[no-untyped-call]
            loss = chords_of(model, part).sum()
            optimiser.zero_grad()
            mean = loss * (distributed.world_size() / size)  # whose mean over all processes is that of the batch
            mean.backward()  # type: ignore[no-untyped-call]
            torch.nn.utils.clip_grad_norm_(network.parameters(), fit.clip)
            optimiser.step()
            schedule.step()
            learned += loss.detach()
        with torch.no_grad():
            parts = validation.to(stored).split(65536)  # type: ignore[no-untyped-call]
            tested = [chords_of(network, part) for part in parts]
            sums = [sum(part.sum().item() for part in tested), sum(angle_sum(part) for part in tested)]
        counts = [len(training), len(validation), len(validation)]
        total, of = distributed.all_reduce(np.array([[learned.item(), *sums], counts], np.float64))
        training_loss, validation_loss, angle = (total / of).tolist()
        log(epoch, training_loss, validation_loss, angle)
        if validation_loss < best_loss:
            best = {name: tensor.clone() for name, tensor in network.state_dict().items()}
            best_loss, best_epoch = validation_loss, epoch
        elif epoch - best_epoch >= fit.patience:
            break
    if not np.isfinite(best_loss):
        raise ConfigError("the training diverged, its loss is not finite: take a smaller fit.learning_rate")
    return {"validation": np.array(best_loss, np.float32), **_arrays(best)}


def _split(rows: NDArray[np.intp], generator: torch.Generator) -> tuple[Tensor, Tensor]:
    """Draw the training and the validation faces. A single face serves as both."""
    order = torch.from_numpy(rows)[torch.randperm(len(rows), generator=generator)]
    cut = max(1, int(0.85 * len(order)))
    return order[:cut], order[cut:] if cut < len(order) else order


def _arrays(state: Mapping[str, Tensor]) -> dict[str, Array]:
    """Return the weights of a network by their names in a `Regression`."""
    arrays = {}
    for name, tensor in state.items():
        _, number, kind = name.split(".")  # "layers.0.weight"; torch multiplies weights from the left
        stored = tensor.T.contiguous() if kind == "weight" else tensor
        arrays[f"{kind}{int(number) + 1}"] = stored.cpu().numpy()
    return arrays
