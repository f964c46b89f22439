"""Training of one cluster's network in torch; nothing at run time imports this."""

from collections.abc import Callable
from itertools import pairwise
from typing import NamedTuple

import numpy as np
import torch
from numpy.typing import NDArray
from torch.nn.parallel import DistributedDataParallel

from cascadenorm.learned import processes
from cascadenorm.learned.config import Fit
from cascadenorm.learned.descriptors import Stack
from cascadenorm.learned.regression import Array


class Faces(NamedTuple):
    """Faces to learn from: numbers that describe them (m, d), filtered normals (m, k, 3), true normals (m, 3)."""

    numbers: Array
    stack: Stack
    truth: Array


ACTIVATIONS: dict[str, Callable[[torch.Tensor], torch.Tensor]] = {
    "tanh": torch.tanh,
    "silu": torch.nn.functional.silu,
}
"""As in `regression`, for torch."""


class Network(torch.nn.Module):
    """Hidden layers, from the numbers of a face to one coefficient a filtered normal."""

    def __init__(self, inputs: int, fit: Fit, outputs: int, generator: torch.Generator) -> None:
        super().__init__()
        self.activation = ACTIVATIONS[fit.activation]
        layers = [torch.nn.Linear(i, o) for i, o in pairwise([inputs, *fit.hidden, outputs])]
        for layer in layers:
            bound = layer.in_features**-0.5
            torch.nn.init.uniform_(layer.weight, -bound, bound, generator=generator)
            torch.nn.init.zeros_(layer.bias)
        torch.nn.init.constant_(layers[-1].bias, 1 / outputs)  # begins as the mean of the normals
        self.layers = torch.nn.ModuleList(layers)

    def forward(self, numbers: torch.Tensor, stack: torch.Tensor) -> torch.Tensor:
        """Return unit normals, (m, 3)."""
        for layer in self.layers[:-1]:
            numbers = self.activation(layer(numbers))
        coefficients = self.layers[-1](numbers)
        return torch.nn.functional.normalize((coefficients[:, :, None] * stack).sum(dim=1), dim=1)


def chord(predicted: torch.Tensor, truth: torch.Tensor) -> torch.Tensor:
    """Return the mean distance between unit normals: robust, where its square follows the few that fail."""
    return torch.sqrt(((predicted - truth) ** 2).sum(dim=1) + 1e-8).mean()


def train_network(
    faces: Faces,
    rows: NDArray[np.intp],
    fit: Fit,
    *,
    seed: int,
    log: Callable[[int, float, float], None] = lambda *_: None,
) -> dict[str, Array]:
    """Train a network on 85 % of some faces, stop by the other 15 %, return the best weights.

    Several processes average their gradients, and each takes its part of a batch.

    Parameters
    ----------
    faces : of all clusters, those of this process
    rows : those of one cluster, at least one
    fit : settings
    seed : of the split, the first weights and the order of the batches
    log : called after each pass with its number from 1, the training loss and the validation loss

    Returns
    -------
    weight1 (d, h), bias1 (h,) and so on up to the k coefficients, and validation (), their loss on the 15 %
    """
    generator = torch.Generator().manual_seed(seed)
    tensors = [torch.from_numpy(array) for array in faces]
    order = torch.from_numpy(rows)[torch.randperm(len(rows), generator=generator)]
    cut = max(1, int(0.85 * len(order)))
    training, validation = order[:cut], order[cut:] if cut < len(order) else order
    network = Network(faces.numbers.shape[1], fit, faces.stack.shape[1], generator).to(processes.device())
    model = DistributedDataParallel(network) if processes.count() > 1 else network
    optimiser = torch.optim.AdamW(network.parameters(), lr=fit.learning_rate, weight_decay=fit.weight_decay)
    used, batch = processes.least(len(training)), max(1, fit.batch // processes.count())
    schedule = torch.optim.lr_scheduler.CosineAnnealingLR(optimiser, fit.epochs * -(-used // batch))
    best, best_loss, best_epoch = network.state_dict(), np.inf, 0
    for epoch in range(1, fit.epochs + 1):
        total = 0.0
        drawn = training[torch.randperm(len(training), generator=generator)][:used]
        for rows in drawn.split(batch):  # type: ignore[no-untyped-call]
            numbers, stack, truth = (t[rows].to(processes.device()) for t in tensors)
            loss = chord(model(numbers, stack), truth)
            optimiser.zero_grad()
            loss.backward()  # type: ignore[no-untyped-call]
            torch.nn.utils.clip_grad_norm_(network.parameters(), fit.clip)
            optimiser.step()
            schedule.step()
            total += loss.item() * len(rows)
        validation_loss = _loss(network, tensors, validation)
        log(epoch, total / used, validation_loss)
        if validation_loss < best_loss:
            best = {name: t.clone() for name, t in network.state_dict().items()}
            best_loss, best_epoch = validation_loss, epoch
        elif epoch - best_epoch >= fit.patience:
            break
    arrays = {"validation": np.array(best_loss, np.float32)}
    for n in range(len(network.layers)):
        arrays[f"weight{n + 1}"] = best[f"layers.{n}.weight"].T.contiguous().cpu().numpy()
        arrays[f"bias{n + 1}"] = best[f"layers.{n}.bias"].cpu().numpy()
    return arrays


def _loss(network: Network, tensors: list[torch.Tensor], rows: torch.Tensor) -> float:
    """Mean over the given faces of all processes."""
    loss = 0.0
    with torch.no_grad():
        for part in rows.split(65536):  # type: ignore[no-untyped-call]
            numbers, stack, truth = (t[part].to(processes.device()) for t in tensors)
            loss += chord(network(numbers, stack), truth).item() * len(part)
    loss, count = processes.total(np.array([loss, len(rows)]))
    return float(loss / count)
