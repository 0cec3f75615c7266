"""Planes times lines, or three lines, in the kernels: no more densities than a ray sees, and components that are never
all in memory."""

from collections.abc import Mapping
from typing import TYPE_CHECKING

import torch
from jaxtyping import Float, Int32
from torch import Tensor

from ringlight import _kernels
from ringlight.volume import halves
from ringlight.volume.factors import Factors
from ringlight.volume.native_march import MarchedRays, ShownSamples, native_rays, native_space, room_for_units
from ringlight.volume.shading import FeatureShading, named_layers

if TYPE_CHECKING:
    from ringlight.volume.factored import FactoredField


class FactoredSource:
    """A :class:`ringlight.volume.native_march.FieldSource`."""

    ways_back_at_once = False

    def __init__(self, field: "FactoredField", shading: FeatureShading):
        self.field = field
        self.network, self.units = {"field.basis": field.basis, **named_layers(shading)}, shading.hidden_units

    def density_values(self, places: Float[Tensor, "N 3"]) -> Float[Tensor, "N"]:
        found = places.new_empty(len(places))
        _kernels.volume_density(_tensors(self.field.density_factors), places.contiguous(), found)
        return found

    def march(self, through: MarchedRays) -> None:
        self.through = through
        _kernels.volume_march(
            native_rays(through.rays), native_space(through.space), _tensors(self.field.density_factors),
            through.optics, through.offsets, list(through.samples), through.shown, through.alpha, through.depth,
        )  # fmt: skip

    def shade(self, through: MarchedRays, shown: ShownSamples, keeps: bool) -> Float[Tensor, "S 3"]:
        self.shown = shown
        colors = torch.empty(len(shown.samples), 3)
        self.hidden = room_for_units(len(colors), self.units) if keeps else None
        _kernels.volume_shade(*self._looked_at(shown), halves.multiplies_halves(), colors, self.hidden)
        return colors

    def density_gradients(self, rows: Int32[Tensor, "C"], grad_density: Float[Tensor, "C"]) -> Mapping[str, Tensor]:
        return _scattered(self.field.density_factors, self.through.places, rows, grad_density, "field.density_factors.")

    def color_gradients(self, rows: Int32[Tensor, "C"], grad_colors: Float[Tensor, "C 3"]) -> Mapping[str, Tensor]:
        appearance, shown = self.field.appearance_factors, self.shown.some(rows)
        found = {name: torch.empty_like(tensor, requires_grad=False) for name, tensor in self.network.items()}
        components = torch.empty(len(shown.samples), appearance.width)
        hidden, self.hidden = self.hidden, None  # the next step's shall not lie beside them
        if hidden is not None and len(rows) < hidden.shape[1]:
            hidden = hidden.index_select(1, rows)
        _kernels.volume_shade_gradient(
            *self._looked_at(shown), halves.multiplies_halves(), hidden, grad_colors, components, list(found.values())
        )
        prefix = "field.appearance_factors."
        return found | _scattered(appearance, self.through.places, shown.samples, components, prefix)

    def _looked_at(
        self, shown: ShownSamples
    ) -> tuple[tuple[list[Tensor], Tensor, Tensor], list[Tensor], Tensor, Tensor]:
        sampled = (_tensors(self.field.appearance_factors), self.through.places, shown.samples)
        return sampled, list(self.network.values()), shown.rays, self.through.rays.directions.contiguous()


def _scattered(
    factors: Factors,
    places: Float[Tensor, "M 3"],
    samples: Int32[Tensor, "S"],
    gradient: Tensor,
    prefix: str,
) -> dict[str, Tensor]:
    found = [torch.zeros_like(tensor, requires_grad=False) for tensor in _tensors(factors)]
    _kernels.volume_scatter(_tensors(factors), places, samples, gradient, found)
    return {f"{prefix}{name}": tensor for (name, _), tensor in zip(_named(factors), found, strict=True)}


def _tensors(factors: Factors) -> list[Tensor]:
    return [tensor for _, tensor in _named(factors)]


def _named(factors: Factors) -> list[tuple[str, Tensor]]:
    """Planes, if there are any, before lines, as the kernels take them."""
    return [
        (f"{kind}.{k}", tensor)
        for kind, tensors in (("planes", factors.planes), ("lines", factors.lines))
        for k, tensor in enumerate(tensors)
    ]
