"""Rays through a volume by torch, and their way back by autograd."""

from collections.abc import Callable, Mapping

from jaxtyping import Float
from torch import Tensor

from ringlight.core.by_autograd import ByAutograd
from ringlight.core.gradients import Gradients
from ringlight.core.rendering import Rendering
from ringlight.core.want import Want
from ringlight.data.rays import Rays
from ringlight.volume.marching import Space, marched
from ringlight.volume.pictures import BUFFERS

OfPlaces = Callable[[Tensor], Tensor]
OfLooks = Callable[[Tensor, Tensor], Tensor]


def rendered_in_torch(
    rays: Rays,
    space: Space,
    density: OfPlaces,
    color: OfLooks,
    background: Float[Tensor, "3"],
    parameters: Mapping[str, Tensor],
    want: Want,
) -> Rendering:
    """Colours, alpha and depth, and gradients of the ``parameters`` by their names where those are wanted."""
    recorded = ByAutograd(lambda _: marched(rays, space, density, color, background), {}, parameters)
    outputs = recorded.outputs
    buffers = {name: outputs[name] for name in BUFFERS}
    if want is not Want.GRADIENTS:
        return Rendering(outputs["color"], outputs["alpha"], buffers)

    def backward(grad_color: Tensor, grad_buffers: Mapping[str, Tensor]) -> Gradients:
        return Gradients(recorded.backward({"color": grad_color, **grad_buffers}))

    return Rendering(outputs["color"], outputs["alpha"], buffers, backward=backward)
