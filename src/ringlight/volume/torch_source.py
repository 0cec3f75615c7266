"""Any field, by torch, between kernels: they place samples, blend them, and make colours of features."""

from collections.abc import Mapping

import torch
from jaxtyping import Float, Int, Int32
from torch import Tensor

from ringlight import _kernels
from ringlight.core.by_autograd import ByAutograd
from ringlight.volume import halves
from ringlight.volume.contract import VolumeField
from ringlight.volume.native_march import MarchedRays, ShownSamples, native_rays, native_space, room_for_units
from ringlight.volume.shading import FeatureShading, named_layers


class TorchSource:
    """A :class:`ringlight.volume.native_march.FieldSource`. The graph of each half lasts until its way back."""

    ways_back_at_once = True

    def __init__(self, field: VolumeField, shading: FeatureShading, with_way_back: bool):
        self.field, self.with_way_back = field, with_way_back
        self.ways_back: dict[str, ByAutograd] = {}
        self.parameters = {f"field.{name}": tensor for name, tensor in field.named_parameters()}
        self.network, self.units = named_layers(shading), shading.hidden_units

    @torch.no_grad()
    def density_values(self, places: Float[Tensor, "N 3"]) -> Float[Tensor, "N"]:
        return self.field.density(places)

    def march(self, through: MarchedRays) -> None:
        rays, samples = native_rays(through.rays), list(through.samples)
        self.samples = len(through.places)
        _kernels.volume_place(rays, native_space(through.space), through.offsets, samples)
        density = self._asked("density", through.places)
        _kernels.volume_weigh(
            through.offsets, density, through.optics, samples, through.shown, through.alpha, through.depth
        )

    def shade(self, through: MarchedRays, shown: ShownSamples, keeps: bool) -> Float[Tensor, "S 3"]:
        self.features = self._asked("appearance", through.places.index_select(0, shown.samples))
        self.rays, self.directions = shown.rays, through.rays.directions.contiguous()
        colors = torch.empty(len(shown.samples), 3)
        self.hidden = room_for_units(len(colors), self.units) if keeps else None
        _kernels.volume_shade(self.features, *self._seen_along(self.rays), colors, self.hidden)
        return colors

    def density_gradients(self, rows: Int32[Tensor, "C"], grad_density: Float[Tensor, "C"]) -> Mapping[str, Tensor]:
        of_samples = grad_density.new_zeros(self.samples).index_copy_(0, rows.long(), grad_density)
        return self.ways_back.pop("density").backward({"density": of_samples})

    def color_gradients(self, rows: Int32[Tensor, "C"], grad_colors: Float[Tensor, "C 3"]) -> Mapping[str, Tensor]:
        found = {name: torch.empty_like(tensor, requires_grad=False) for name, tensor in self.network.items()}
        features, rays = self.features, self.rays
        hidden, self.hidden = self.hidden, None  # the next step's shall not lie beside them
        every = len(rows) == len(features)
        if not every:
            features, rays = features.index_select(0, rows), rays.index_select(0, rows)
            hidden = None if hidden is None else hidden.index_select(1, rows)
        grad_features = torch.empty_like(features)
        _kernels.volume_shade_gradient(
            features, *self._seen_along(rays), hidden, grad_colors, grad_features, list(found.values())
        )
        if not every:
            grad_features = torch.zeros_like(self.features).index_copy_(0, rows.long(), grad_features)
        return found | self.ways_back.pop("appearance").backward({"appearance": grad_features})

    def _seen_along(self, rays: Int[Tensor, "C"]) -> tuple[list[Tensor], Tensor, Tensor, bool]:
        return list(self.network.values()), rays, self.directions, halves.multiplies_halves()

    def _asked(self, name: str, places: Float[Tensor, "N 3"]) -> Tensor:
        ask = {"density": self.field.density, "appearance": self.field.appearance}[name]
        if not self.with_way_back:
            with torch.no_grad():
                return ask(places).contiguous()
        self.ways_back[name] = ByAutograd(lambda _: {name: ask(places)}, {}, self.parameters)
        return self.ways_back[name].outputs[name].contiguous()
