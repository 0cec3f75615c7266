"""Small multilayer perceptrons with PyTorch's default start, drawn from a generator that the caller owns."""

from collections.abc import Sequence
from itertools import pairwise

import torch
from jaxtyping import Float
from torch import Tensor, nn


def fan_in_uniform(shape: Sequence[int], fan_in: int, generator: torch.Generator) -> nn.Parameter:
    """Uniform within 1/sqrt(fan_in), what ``nn.Linear`` starts with for weights and biases alike."""
    bound = fan_in**-0.5
    return nn.Parameter(torch.empty(tuple(shape)).uniform_(-bound, bound, generator=generator))


def perceptron(widths: Sequence[int], generator: torch.Generator) -> nn.Sequential:
    """Linear layers between ``widths`` with ReLU in between, none after the last."""
    layers: list[nn.Module] = []
    for inputs, outputs in pairwise(widths):
        layer = nn.utils.skip_init(nn.Linear, inputs, outputs)
        layer.weight = fan_in_uniform((outputs, inputs), inputs, generator)
        layer.bias = fan_in_uniform((outputs,), inputs, generator)
        layers += [layer, nn.ReLU()]
    return nn.Sequential(*layers[:-1])


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
