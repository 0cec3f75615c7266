"""Small multilayer perceptrons with PyTorch's default start, drawn from a generator that the caller owns."""

from collections.abc import Sequence
from itertools import pairwise

import torch
from jaxtyping import Float
from torch import Tensor, nn

from ringlight.core.triton_kernels import multiplies_halves, runs_triton


def fan_in_uniform(shape: Sequence[int], fan_in: int, generator: torch.Generator) -> nn.Parameter:
    """Uniform within 1/sqrt(fan_in), what ``nn.Linear`` starts with for weights and biases alike."""
    bound = fan_in**-0.5
    return nn.Parameter(torch.empty(tuple(shape)).uniform_(-bound, bound, generator=generator))


MOST_INPUTS_IN_TRITON, WIDEST_IN_TRITON, WIDEST_FLAT_IN_TRITON = 32, 64, 128
"""Inputs or outputs, hidden units in two layers, and in one, that fit a GPU's registers beside the rows: with 64 inputs
the backward kernel would spill 4 KB a thread, with two layers of 128 ask for 114 KB of shared memory."""


class Perceptron(nn.Sequential):
    """Linear layers with ReLU in between; on a GPU one kernel, where the network is small enough."""

    def forward(self, rows: Float[Tensor, "N inputs"]) -> Float[Tensor, "N outputs"]:
        """The outputs for each row."""
        if not self._fits_triton(rows):
            result: Tensor = super().forward(rows)
            return result
        from ringlight.fields.perceptron_triton import perceptron_by_triton

        return perceptron_by_triton(rows, list(self.parameters()), half=multiplies_halves())

    def hidden(self, rows: Float[Tensor, "N inputs"]) -> Float[Tensor, "N units"]:
        """The hidden units of all layers, after their ReLU."""
        found = []
        for layer in self:
            rows = layer(rows)
            if isinstance(layer, nn.ReLU):
                found.append(rows)
        return torch.cat(found, -1)

    def _fits_triton(self, rows: Tensor) -> bool:
        layers = [layer for layer in self if isinstance(layer, nn.Linear)]
        hidden = {layer.out_features for layer in layers[:-1]}
        widest = WIDEST_FLAT_IN_TRITON if len(layers) == 2 else WIDEST_IN_TRITON
        small = len(layers) in (2, 3) and len(hidden) == 1 and max(hidden) <= widest
        small = small and max(layers[0].in_features, layers[-1].out_features) <= MOST_INPUTS_IN_TRITON
        return small and runs_triton(rows, *self.parameters())


def perceptron(widths: Sequence[int], generator: torch.Generator) -> Perceptron:
    """Linear layers between ``widths`` with ReLU in between, none after the last."""
    layers: list[nn.Module] = []
    for inputs, outputs in pairwise(widths):
        layer = nn.utils.skip_init(nn.Linear, inputs, outputs)
        layer.weight = fan_in_uniform((outputs, inputs), inputs, generator)
        layer.bias = fan_in_uniform((outputs,), inputs, generator)
        layers += [layer, nn.ReLU()]
    return Perceptron(*layers[:-1])


class PerceptronStack(nn.Module):
    """H independent perceptrons of one shape, evaluated together by batched products.

    ``weights.l`` is [H inputs outputs] and ``biases.l`` [H 1 outputs] for layer l.
    """

    def __init__(self, heads: int, widths: Sequence[int], generator: torch.Generator):
        super().__init__()
        self.weights, self.biases = nn.ParameterList(), nn.ParameterList()
        for inputs, outputs in pairwise(widths):
            self.weights.append(fan_in_uniform((heads, inputs, outputs), inputs, generator))
            self.biases.append(fan_in_uniform((heads, 1, outputs), inputs, generator))

    def forward(self, values: Float[Tensor, "H N inputs"]) -> Float[Tensor, "H N outputs"]:
        """Head h sees ``values[h]``; ReLU between layers, none after the last."""
        for depth, (weight, bias) in enumerate(zip(self.weights, self.biases, strict=True)):
            if depth:
                values = torch.relu(values)
            values = torch.baddbmm(bias, values, weight)
        return values
