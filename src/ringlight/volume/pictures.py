"""Pictures of a volume from its rays: colours and layers of a camera."""

from collections.abc import Callable, Mapping

import torch
from jaxtyping import Float
from torch import Tensor

from ringlight.core.camera import Camera
from ringlight.core.directions import normalize
from ringlight.core.gradients import Gradients
from ringlight.core.rendering import Channels, Rendering
from ringlight.core.want import Want
from ringlight.data.rays import Rays
from ringlight.volume.marching import Space, samples_of, weights_of

CHUNK = 4096
"""Rays of a picture that are marched at once."""

BUFFERS = ("alpha", "depth")

SURFACE = 1e-3
"""Alpha below which a pixel has neither depth nor normal."""


def picture(rendered: Callable[[Rays], Rendering], camera: Camera, rays: Rays, want: Want) -> Rendering:
    """Of what is ``rendered`` for the camera's ``rays``, in parts unless gradients are wanted; "depth" along rays
    becomes depth along the camera's axis."""
    shape, axis = (camera.height, camera.width, -1), (rays.directions @ camera.forward.to(rays.directions))[:, None]
    if want is Want.GRADIENTS:
        whole = rendered(rays)
        color, found = whole.color, dict(whole.buffers)
    else:
        parts = [rendered(rays.part(begin, begin + CHUNK)) for begin in range(0, len(rays), CHUNK)]
        color = torch.cat([part.color for part in parts])
        found = {name: torch.cat([part.buffers[name] for part in parts]) for name in BUFFERS}
    found["depth"] = found["depth"] * axis
    named = {name: values.view(shape) for name, values in found.items()}
    if want is not Want.GRADIENTS:
        return Rendering(color.view(shape), named["alpha"], named)

    def backward(grad_color: Tensor, grad_buffers: Mapping[str, Tensor]) -> Gradients:
        flat = {name: gradient.reshape(-1, 1) for name, gradient in grad_buffers.items()}
        if "depth" in flat:
            flat["depth"] = flat["depth"] * axis
        return whole.backward(grad_color.reshape(-1, 3), flat)

    return Rendering(color.view(shape), named["alpha"], named, backward=backward)


def surface_layers(shown: Rendering, normals: Float[Tensor, "R 3"]) -> Channels:
    """Of a rendering over black, and the normals of its pixels. No part of the colour is split off: the residual is
    zero."""
    alpha, depth = shown.buffers["alpha"], shown.buffers["depth"]
    there = alpha > SURFACE
    return {
        "base": shown.color,
        "residual": torch.zeros_like(shown.color),
        "alpha": alpha,
        "depth": torch.where(there, depth / alpha.clamp_min(SURFACE), 0),
        "normal": torch.where(there, normals.view_as(shown.color), 0),
    }


def against_slopes(
    density: Callable[[Float[Tensor, "N 3"]], Float[Tensor, "N"]], box: Float[Tensor, "2 3"], space: Space, rays: Rays
) -> Float[Tensor, "R 3"]:
    """Blended directions in which a ``density`` of places in the ``box`` falls, world axes: unit, or zero where there
    is nothing."""
    parts = (rays.part(begin, begin + CHUNK) for begin in range(0, len(rays), CHUNK))
    return torch.cat([_against_slopes(density, box, space, part) for part in parts])


def _against_slopes(
    density: Callable[[Tensor], Tensor], box: Float[Tensor, "2 3"], space: Space, rays: Rays
) -> Float[Tensor, "R 3"]:
    samples = samples_of(rays, space)
    with torch.enable_grad():
        places = samples.places.detach().requires_grad_()
        found = density(places)
        (slopes,) = torch.autograd.grad(found.sum(), places) if len(places) else (places,)
    weights = weights_of(samples, len(rays), space.optical * found.detach())
    outward = -normalize(slopes.detach() / (box[1] - box[0]))
    return normalize(outward.new_zeros(len(rays), 3).index_add(0, samples.ray, weights[:, None] * outward))
