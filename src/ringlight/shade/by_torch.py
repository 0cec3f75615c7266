"""Shaders that only know torch: what they show as a record that knows its way back."""

from collections.abc import Callable, Mapping

import torch
from jaxtyping import Float
from torch import Tensor

from ringlight.core.by_autograd import ByAutograd
from ringlight.core.gradients import Gradients
from ringlight.core.rendering import ImageGradients, Shaded
from ringlight.core.want import Want


def shaded_by_torch(
    function: Callable[[Tensor, Tensor], Tensor],
    image: Float[Tensor, "H W C"],
    alpha: Float[Tensor, "H W 1"],
    parameters: Mapping[str, Tensor],
    want: Want,
) -> Shaded:
    """``function`` makes the colours [H W 3] of the blended channels and alpha; ``parameters`` are those that it reads
    besides, by full name."""
    if want is not Want.GRADIENTS:
        with torch.no_grad():
            return Shaded(function(image, alpha))
    inputs = {"image": image, "alpha": alpha}
    recorded = ByAutograd(lambda given: {"color": function(given["image"], given["alpha"])}, inputs, parameters)

    def backward(grad_color: Tensor, into: Gradients) -> ImageGradients:
        found = recorded.backward({"color": grad_color})
        grad_image, grad_alpha = found.pop("image", None), found.pop("alpha", None)
        into.add_all(found)
        return torch.zeros_like(image) if grad_image is None else grad_image, grad_alpha

    return Shaded(recorded.outputs["color"], backward)
