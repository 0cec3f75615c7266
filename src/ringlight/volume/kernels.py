"""The kernels that march through planes times lines, and their way back; compared with ``marching``.

They take float32 on the CPU, factors of the form "vm" whose components are multiples of sixteen, and a network of three
layers. Products of its layers may be of bfloat16.
"""

from collections.abc import Mapping
from dataclasses import dataclass

import torch
from jaxtyping import Bool, Float, Int
from torch import Tensor

from ringlight import _kernels
from ringlight.core.gradients import Gradients
from ringlight.core.rendering import Rendering
from ringlight.data.rays import Rays
from ringlight.volume.factored import FactoredField
from ringlight.volume.factors import Factors
from ringlight.volume.marching import END, SHOWN_WEIGHT, Space
from ringlight.volume.shading import FeatureShading

LANES = 16
"""Components of which a kernel takes whole multiples."""

HALVES = True
"""Whether products of the network's layers may be of bfloat16, where the processor multiplies those faster."""

NOTHING = 0
"""Samples or rows of a lot of rays that meets nothing."""


def runs_native(field: object, shading: FeatureShading) -> bool:
    """Whether the kernels take a field and its network, as these are now."""
    if not isinstance(field, FactoredField):
        return False
    factors = (field.density_factors, field.appearance_factors)
    fits = all(each.kind == "vm" and each.components % LANES == 0 for each in factors)
    parameters = (*field.parameters(), *shading.parameters())
    return fits and all(p.is_cpu and p.dtype == torch.float32 and p.is_contiguous() for p in parameters)


def density_at(factors: Factors, places: Float[Tensor, "N 3"]) -> Float[Tensor, "N"]:
    """Sums of all components."""
    found = places.new_empty(len(places))
    _kernels.volume_density(_tensors(factors), places.contiguous(), found)
    return found


def meets_something(rays: Rays, space: Space) -> Bool[Tensor, "R"]:
    """Whether a sample of a ray lies in a cell that is not empty."""
    return _counted(rays, space) > 0


@dataclass(frozen=True)
class _Samples:
    """What the kernels know of a lot of rays: see kernels/volume/volume.hpp."""

    offsets: Int[Tensor, "O"]
    shown_offsets: Int[Tensor, "O"]
    arrays: tuple[Tensor, ...]
    alpha: Float[Tensor, "R"]
    depth: Float[Tensor, "R"]

    @property
    def places(self) -> Float[Tensor, "M 3"]:
        return self.arrays[0]

    @property
    def weights(self) -> Float[Tensor, "M"]:
        return self.arrays[2]


@dataclass(frozen=True)
class _Shown:
    """Numbers of the samples that have a colour, and of their rays, and these colours."""

    samples: Int[Tensor, "S"]
    rays: Int[Tensor, "S"]
    colors: Float[Tensor, "S 3"]


class Marched:
    """One lot of rays through a field, in a space, by the kernels."""

    def __init__(
        self,
        rays: Rays,
        space: Space,
        shift: float,
        field: FactoredField,
        shading: FeatureShading,
        background: Float[Tensor, "3"],
    ):
        self.rays, self.field, self.shading, self.background = rays, field, shading, background.contiguous()
        self.samples = self._marched(space, shift)
        self.shown = self._shaded()
        self.color = torch.empty(len(rays), 3)
        of = self.samples
        _kernels.volume_blend(
            of.offsets, of.shown_offsets, of.weights, SHOWN_WEIGHT, self.shown.colors, of.alpha, self.background,
            self.color,
        )  # fmt: skip

    def rendering(self, with_way_back: bool) -> Rendering:
        """As a record."""
        buffers = {"alpha": self.samples.alpha[:, None], "depth": self.samples.depth[:, None]}
        if not with_way_back:
            return Rendering(self.color, buffers["alpha"], buffers)
        return Rendering(self.color, buffers["alpha"], buffers, backward=self._backward)

    def _marched(self, space: Space, shift: float) -> _Samples:
        count = len(self.rays)
        offsets = _ends(_counted(self.rays, space))
        total = int(offsets[-1])
        arrays = (torch.empty(total, 3), *(torch.empty(total) for _ in range(4)))
        shown = torch.empty(count, dtype=torch.int32)
        alpha, depth = torch.empty(count), torch.empty(count)
        optics = (shift, space.optical, SHOWN_WEIGHT, END)
        factors = _tensors(self.field.density_factors)
        _kernels.volume_march(
            _native_rays(self.rays), _native_space(space), factors, optics, offsets, list(arrays), shown, alpha, depth
        )
        return _Samples(offsets, _ends(shown), arrays, alpha, depth)

    def _shaded(self) -> _Shown:
        of = self.samples
        samples = (of.weights > SHOWN_WEIGHT).nonzero()[:, 0].int()
        rays = torch.repeat_interleave(torch.arange(len(self.rays), dtype=torch.int32), of.shown_offsets.diff())
        colors = torch.empty(len(samples), 3)
        factors, network = _tensors(self.field.appearance_factors), _network(self.field, self.shading)
        _kernels.volume_shade(
            factors, network, samples, rays, of.places, self.rays.directions.contiguous(), HALVES, colors
        )
        return _Shown(samples, rays, colors)

    def _backward(self, grad_color: Tensor, grad_buffers: Mapping[str, Tensor]) -> Gradients:
        of, shown = self.samples, self.shown
        grad_colors, grad_density = torch.empty_like(shown.colors), torch.empty_like(of.weights)
        of_alpha, of_depth = (
            None if (found := grad_buffers.get(name)) is None else found.contiguous() for name in ("alpha", "depth")
        )
        _kernels.volume_unblend(
            of.offsets, of.shown_offsets, list(of.arrays), SHOWN_WEIGHT, shown.colors, self.background,
            grad_color.contiguous(), of_alpha, of_depth, grad_colors, grad_density,
        )  # fmt: skip
        gradients = Gradients()
        _scatter(self.field.density_factors, of.places, None, grad_density, "field.density_factors.", gradients)
        appearance = self.field.appearance_factors
        network = _network(self.field, self.shading)
        grad_network = [torch.empty_like(tensor, requires_grad=False) for tensor in network]
        grad_components = torch.empty(len(shown.samples), appearance.width)
        _kernels.volume_shade_gradient(
            _tensors(appearance), network, shown.samples, shown.rays, of.places, self.rays.directions.contiguous(),
            HALVES, grad_colors, grad_components, grad_network,
        )  # fmt: skip
        gradients.add_all(dict(zip(_network_names(), grad_network, strict=True)))
        _scatter(appearance, of.places, shown.samples, grad_components, "field.appearance_factors.", gradients)
        return gradients


def _scatter(
    factors: Factors,
    places: Float[Tensor, "M 3"],
    samples: Int[Tensor, "S"] | None,
    gradient: Tensor,
    prefix: str,
    gradients: Gradients,
) -> None:
    found = [torch.zeros_like(tensor, requires_grad=False) for tensor in _tensors(factors)]
    _kernels.volume_scatter(_tensors(factors), places, samples, gradient, found)
    names = [f"{prefix}{kind}.{k}" for kind in ("planes", "lines") for k in range(3)]
    gradients.add_all(dict(zip(names, found, strict=True)))


def _counted(rays: Rays, space: Space) -> Int[Tensor, "R"]:
    counts = torch.empty(len(rays), dtype=torch.int32)
    _kernels.volume_count(_native_rays(rays), _native_space(space), counts)
    return counts


def _ends(counts: Int[Tensor, "R"]) -> Int[Tensor, "O"]:
    ends = torch.zeros(len(counts) + 1, dtype=torch.int64)
    torch.cumsum(counts, 0, out=ends[1:])
    return ends


def _native_rays(rays: Rays) -> tuple[Tensor, Tensor, Tensor]:
    return rays.origins.contiguous(), rays.directions.contiguous(), rays.jitter.contiguous()


def _native_space(space: Space) -> tuple[list[float], Tensor, float, int]:
    corners = [*space.box.flatten().tolist(), *space.occupied_box.flatten().tolist()]
    return corners, space.occupied.contiguous().view(torch.int8), space.step, space.most


def _tensors(factors: Factors) -> list[Tensor]:
    return [*factors.planes.parameters(), *factors.lines.parameters()]


def _network(field: FactoredField, shading: FeatureShading) -> list[Tensor]:
    return [field.basis, *shading.network.parameters()]


def _network_names() -> list[str]:
    layers = [f"shading.network.{layer}.{kind}" for layer in (0, 2, 4) for kind in ("weight", "bias")]
    return ["field.basis", *layers]
