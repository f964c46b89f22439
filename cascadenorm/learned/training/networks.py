"""Features and networks in torch, for training."""

from collections.abc import Callable, Sequence
from itertools import pairwise

import torch
from torch import Tensor

from cascadenorm.learned.features import FLOOR, FeatureScaler
from cascadenorm.learned.stage import Activation


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
