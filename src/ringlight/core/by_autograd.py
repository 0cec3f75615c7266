"""The way back of a part that only knows torch: autograd, cut off from everything around the part."""

from collections.abc import Callable, Mapping

import torch
from torch import Tensor

Named = dict[str, Tensor]


class ByAutograd:
    """Runs ``function`` on copies of ``inputs`` that share their memory, and records a graph from them.

    ``parameters`` are what the function reads besides: gradients reach those that require one. ``outputs`` are without
    a graph.
    """

    def __init__(
        self, function: Callable[[Named], Named], inputs: Named, parameters: Mapping[str, Tensor] | None = None
    ):
        leaves = {name: tensor.detach().requires_grad_() for name, tensor in inputs.items()}
        with torch.enable_grad():
            self._ends = function(leaves)
        shared = {name: tensor for name, tensor in (parameters or {}).items() if tensor.requires_grad}
        self._sources = leaves | shared
        self.outputs = {name: end.detach() for name, end in self._ends.items()}

    def backward(self, grad_outputs: Mapping[str, Tensor | None]) -> Named:
        """Gradients of inputs and parameters by name, of those that had a part in outputs with a gradient. Once."""
        ends = [
            (end, gradient)
            for name, end in self._ends.items()
            if end.requires_grad and (gradient := grad_outputs.get(name)) is not None
        ]
        if not ends:
            return {}
        outputs, gradients = zip(*ends, strict=True)
        sources = self._sources
        found = torch.autograd.grad(outputs, list(sources.values()), gradients, allow_unused=True)
        return {name: gradient for name, gradient in zip(sources, found, strict=True) if gradient is not None}
