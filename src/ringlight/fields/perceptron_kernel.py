"""The kernel that runs a stack of perceptrons at fixed rows: the heads at their tables' nodes.

Some sixty small torch operations a step otherwise, which wake torch's own threads while ours wait for work.
"""

import torch
from jaxtyping import Float
from torch import Tensor

from ringlight import _kernels
from ringlight.core.by_autograd import ByAutograd
from ringlight.fields.networks import PerceptronStack

LAYERS = 3


@torch.no_grad()
def stack_at(stack: PerceptronStack, rows: Float[Tensor, "H K inputs"]) -> Float[Tensor, "H K outputs"]:
    """``stack(rows)`` without a graph; by the kernel where it applies: three layers, float32, CPU."""
    if not _runs_native(stack, rows):
        return stack(rows)
    parameters = stack_parameters(stack)
    results = rows.new_empty(*rows.shape[:2], parameters[-1].shape[-1])
    _kernels.perceptron_forward(parameters, rows.contiguous(), results)
    return results


def stack_gradients(
    stack: PerceptronStack,
    rows: Float[Tensor, "H K inputs"],
    grad_results: Float[Tensor, "H K outputs"],
    of_rows: Float[Tensor, "H K inputs"] | None = None,
) -> dict[str, Tensor]:
    """The way back of :func:`stack_at`: gradients by the stack's parameter names; that of ``rows`` is written to
    ``of_rows`` where it is given."""
    if not _runs_native(stack, rows):
        recorded = ByAutograd(lambda at: {"results": stack(at["rows"])}, {"rows": rows}, dict(stack.named_parameters()))
        found = recorded.backward({"results": grad_results})
        grad_rows = found.pop("rows")
        if of_rows is not None:
            of_rows.copy_(grad_rows)
        return found
    parameters = stack_parameters(stack)
    gradients = [torch.empty_like(parameter, requires_grad=False) for parameter in parameters]
    _kernels.perceptron_backward(parameters, rows.contiguous(), grad_results.contiguous(), gradients, of_rows)
    return dict(zip(stack_parameter_names(), gradients, strict=True))


def _runs_native(stack: PerceptronStack, rows: Tensor) -> bool:
    return len(stack.weights) == LAYERS and rows.dtype == torch.float32 and rows.device.type == "cpu"


def stack_parameter_names() -> list[str]:
    """In the kernels' order."""
    return [f"{kind}.{layer}" for layer in range(LAYERS) for kind in ("weights", "biases")]


def stack_parameters(stack: PerceptronStack) -> list[Tensor]:
    """Weight and bias of each layer."""
    # Not by index: torch's list of parameters looks each number up as a name, four times over.
    layers = zip(stack.weights.parameters(False), stack.biases.parameters(False), strict=True)
    return [tensor.contiguous() for layer in layers for tensor in layer]
