"""Rasterizers that only know torch: their pictures as records that know their way back."""

from collections.abc import Callable

import torch
from jaxtyping import Float
from torch import Tensor

from ringlight.core.by_autograd import ByAutograd
from ringlight.core.gaussians import GEOMETRY, Gaussians
from ringlight.core.gradients import COLUMNS, Gradients
from ringlight.core.rendering import Emission, EmissionGradients, Footprint, Raster
from ringlight.core.want import Want

Blend = Callable[[dict[str, Tensor | None]], tuple[Tensor, Tensor, Footprint]]
"""Image [H W C], alpha [H W 1] and footprint, whose gradients autograd fills in, of the geometry's columns by name,
"channels" and "opacity_factor", which may be None."""


def drawn_by_torch(blend: Blend, gaussians: Gaussians, emission: Emission, want: Want) -> Raster:
    """What a rasterizer's ``draw`` returns; see :class:`ringlight.rasterize.contract.Rasterizer`."""
    columns: dict[str, Tensor] = {name: getattr(gaussians, name) for name in GEOMETRY}
    columns["channels"] = emission.channels
    if emission.opacity_factor is not None:
        columns["opacity_factor"] = emission.opacity_factor
    if want is not Want.GRADIENTS:
        with torch.no_grad():
            return Raster(*blend({"opacity_factor": None, **columns}))
    footprints: list[Footprint] = []

    def record(leaves: dict[str, Tensor]) -> dict[str, Tensor]:
        image, alpha, footprint = blend({"opacity_factor": None, **leaves})
        footprints.append(footprint)
        return {"image": image, "alpha": alpha}

    recorded = ByAutograd(record, columns)

    def backward(
        grad_image: Float[Tensor, "H W C"], grad_alpha: Float[Tensor, "H W 1"] | None, into: Gradients
    ) -> EmissionGradients:
        found = recorded.backward({"image": grad_image, "alpha": grad_alpha})
        found = {name: found.get(name, torch.zeros_like(column)) for name, column in columns.items()}
        for name in GEOMETRY:
            into.add(COLUMNS + name, found[name])
        return found["channels"], found.get("opacity_factor")

    return Raster(recorded.outputs["image"], recorded.outputs["alpha"], footprints[0], backward)
