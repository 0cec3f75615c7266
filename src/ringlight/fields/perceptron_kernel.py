"""Autograd glue over the kernel that runs a stack of perceptrons at fixed rows: the heads at their tables' nodes.

Some sixty small torch operations a step otherwise, which wake torch's own threads while ours wait for work.
"""

from collections.abc import Sequence
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
    rows, parameters = rows.contiguous(), _parameters(stack)
    if not torch.is_grad_enabled():
        return _results(rows, parameters)
    results: Tensor = _StackAt.apply(rows, *parameters)
    return results


def stack_gradients(
    stack: PerceptronStack, rows: Float[Tensor, "H K inputs"], upstream: Float[Tensor, "H K outputs"]
) -> dict[str, Tensor]:
    """What autograd makes of :func:`stack_at`, where the kernel applies: gradients by the stack's parameter names."""
    gradients = _gradients(rows.contiguous(), _parameters(stack), upstream)
    names = [f"{kind}.{layer}" for layer in range(LAYERS) for kind in ("weights", "biases")]
    return dict(zip(names, gradients, strict=True))


def _parameters(stack: PerceptronStack) -> list[Tensor]:
    # Not by index: torch's list of parameters looks each number up as a name, four times over.
    layers = zip(stack.weights.parameters(False), stack.biases.parameters(False), strict=True)
    return [tensor.contiguous() for layer in layers for tensor in layer]


def _results(rows: Tensor, parameters: Sequence[Tensor]) -> Tensor:
    results = rows.new_empty(*rows.shape[:2], parameters[-1].shape[-1])
    _kernels.perceptron_forward(parameters, rows, results)
    return results


def _gradients(rows: Tensor, parameters: Sequence[Tensor], upstream: Tensor) -> list[Tensor]:
    gradients = [torch.empty_like(parameter, requires_grad=False) for parameter in parameters]
    _kernels.perceptron_backward(parameters, rows, upstream.contiguous(), gradients)
    return gradients


class _StackAt(torch.autograd.Function):
    @staticmethod
    def forward(ctx: Any, rows: Tensor, *parameters: Tensor) -> Tensor:
        ctx.save_for_backward(rows, *parameters)
        return _results(rows, parameters)

    @staticmethod
    @torch.autograd.function.once_differentiable
    def backward(ctx: Any, upstream: Tensor) -> tuple[Tensor | None, ...]:
        rows, *parameters = ctx.saved_tensors
        return None, *_gradients(rows, parameters, upstream)
