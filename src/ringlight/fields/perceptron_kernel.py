"""Autograd glue over the kernel that runs a stack of perceptrons at fixed rows: the heads at their tables' nodes.

Some sixty small torch operations a step otherwise, which wake torch's own threads while ours wait for work.
"""

from typing import Any

import torch
from jaxtyping import Float
from torch import Tensor

from ringlight import _kernels
from ringlight.fields.networks import PerceptronStack

LAYERS = 3


def stack_at(stack: PerceptronStack, rows: Float[Tensor, "H K inputs"]) -> Float[Tensor, "H K outputs"]:
    """``stack(rows)`` by the kernel where it applies: three layers, float32, CPU. No gradient reaches ``rows``."""
    if len(stack.weights) != LAYERS or rows.dtype != torch.float32 or rows.device.type != "cpu":
        return stack(rows)
    layers = zip(stack.weights, stack.biases, strict=True)
    parameters = [tensor.contiguous() for layer in layers for tensor in layer]
    results: Tensor = _StackAt.apply(rows.contiguous(), *parameters)
    return results


class _StackAt(torch.autograd.Function):
    @staticmethod
    def forward(ctx: Any, rows: Tensor, *parameters: Tensor) -> Tensor:
        results = rows.new_empty(*rows.shape[:2], parameters[-1].shape[-1])
        _kernels.perceptron_forward(parameters, rows, results)
        ctx.save_for_backward(rows, *parameters)
        return results

    @staticmethod
    @torch.autograd.function.once_differentiable
    def backward(ctx: Any, upstream: Tensor) -> tuple[Tensor | None, ...]:
        rows, *parameters = ctx.saved_tensors
        gradients = [torch.empty_like(parameter) for parameter in parameters]
        _kernels.perceptron_backward(parameters, rows, upstream.contiguous(), gradients)
        return None, *gradients
