"""Features and networks in torch, for training."""

from collections.abc import Callable, Sequence
from itertools import pairwise

import torch
from torch import Tensor

from cascadenorm.learned.features import FLOOR, FeatureScaler
from cascadenorm.learned.stage import Activation


class TorchFeatures:
    """Compute `FeatureScaler.features` in torch."""

    def __init__(self, scaler: FeatureScaler, device: torch.device) -> None:
        self._first, self._second = torch.tensor(scaler.pairs.T.astype(int), device=device)
        self._mean, self._scale, self._context_mean, self._context_scale = (
            torch.tensor(array, device=device)
            for array in (scaler.mean, scaler.scale, scaler.context_mean, scaler.context_scale)
        )

    def own(self, stack: Tensor) -> Tensor:
        """Return the normalised features of the faces without their context, (m, d)."""
        axes = stack.transpose(1, 2).contiguous()
        x, y, z = (axes.index_select(2, self._first) - axes.index_select(2, self._second)).square_().unbind(dim=1)
        return ((0.5 * (x + y + z) + FLOOR).log_() - self._mean).mul_(self._scale)

    def __call__(self, stack: Tensor, context: Tensor) -> Tensor:
        """Return the normalised features of the faces and of their context, (m, d + c)."""
        return torch.cat([self.own(stack), (context - self._context_mean) * self._context_scale], dim=1)


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
