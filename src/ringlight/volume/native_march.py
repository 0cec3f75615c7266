"""Rays through a volume by the kernels, and their way back; compared with ``marching``.

They take float32 on the CPU and a network of three layers. Products of its layers may be of bfloat16. A
:class:`FieldSource` says what densities and features are.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Protocol, runtime_checkable

import torch
from jaxtyping import Float, Int, Int32
from torch import Tensor

from ringlight import _kernels
from ringlight.core.gradients import Gradients
from ringlight.core.rendering import Rendering
from ringlight.core.shared_pieces import both
from ringlight.data.rays import Rays
from ringlight.volume.contract import VolumeField
from ringlight.volume.halves import multiplies_halves
from ringlight.volume.marching import END, SHOWN_WEIGHT, Space
from ringlight.volume.shading import FeatureShading

MOST_KEPT = 1 << 26
"""Hidden units of a step, a quarter of a gigabyte, and twice that while those of some rows are picked. What is all fog,
at the start, shows many times as many samples as later; there they are made again."""


@dataclass(frozen=True)
class MarchedRays:
    """A lot of rays as the kernels know it: see kernels/volume/volume.hpp. ``samples`` are places, along, weights,
    left, slopes; ray r has those from ``offsets[r]`` to ``offsets[r + 1]``. ``shown`` counts those of a ray that have a
    colour. A source fills all but ``offsets``."""

    rays: Rays
    space: Space
    shift: float
    offsets: Int[Tensor, "O"]
    samples: tuple[Tensor, ...]
    shown: Int[Tensor, "R"]
    alpha: Float[Tensor, "R"]
    depth: Float[Tensor, "R"]

    @staticmethod
    def of(rays: Rays, space: Space, shift: float) -> "MarchedRays":
        """With room for all samples that are not known to be empty."""
        count, offsets = len(rays), _ends(samples_in(space, rays))
        total = int(offsets[-1])
        samples = (torch.empty(total, 3), *(torch.empty(total) for _ in range(4)))
        shown = torch.empty(count, dtype=torch.int32)
        return MarchedRays(rays, space, shift, offsets, samples, shown, torch.empty(count), torch.empty(count))

    @property
    def optics(self) -> tuple[float, float, float, float]:
        """As the kernels take them."""
        return self.shift, self.space.optical, SHOWN_WEIGHT, END

    @property
    def places(self) -> Float[Tensor, "M 3"]:
        """Of samples, in the box's [0, 1]^3."""
        return self.samples[0]

    @property
    def weights(self) -> Float[Tensor, "M"]:
        """Of samples, of what is seen."""
        return self.samples[2]


@dataclass(frozen=True)
class ShownSamples:
    """Numbers of the samples that have a colour, and of their rays."""

    samples: Int[Tensor, "S"]
    rays: Int[Tensor, "S"]

    def some(self, rows: Int32[Tensor, "C"]) -> "ShownSamples":
        """Those of these numbers."""
        return ShownSamples(self.samples.index_select(0, rows), self.rays.index_select(0, rows))


@runtime_checkable
class FieldSource(Protocol):
    """A field for one lot of rays. The methods but the first are called in this order, the last two at most once; these
    may be called at once, by two threads, if much of each is done by one thread alone: ``ways_back_at_once``."""

    ways_back_at_once: bool

    def density_values(self, places: Float[Tensor, "N 3"]) -> Float[Tensor, "N"]:
        """What softplus makes density of, without a graph."""
        ...

    def march(self, through: MarchedRays) -> None:
        """Fill what is empty in it."""
        ...

    def shade(self, through: MarchedRays, shown: ShownSamples, keeps: bool) -> Float[Tensor, "S 3"]:
        """Colours of what is shown. ``keeps`` the network's hidden units, if there is room for them, which the way back
        then need not make again."""
        ...

    def density_gradients(self, rows: Int32[Tensor, "C"], grad_density: Float[Tensor, "C"]) -> Mapping[str, Tensor]:
        """By the model's names, from those of what softplus is taken of at some of the samples, by their numbers."""
        ...

    def color_gradients(self, rows: Int32[Tensor, "C"], grad_colors: Float[Tensor, "C 3"]) -> Mapping[str, Tensor]:
        """By the model's names, the network's among them, from those of some of the colours, by their numbers."""
        ...


def runs_native(field: VolumeField, shading: FeatureShading) -> bool:
    """Whether the kernels take a field and its network, as these are now."""
    parameters = [parameter for _, parameter in field.named_parameters()] + list(shading.parameters())
    return all(p.is_cpu and p.dtype == torch.float32 and p.is_contiguous() for p in parameters)


def samples_in(space: Space, rays: Rays) -> Int[Tensor, "R"]:
    """How many of each ray lie in cells that are not empty."""
    counts = torch.empty(len(rays), dtype=torch.int32)
    _kernels.volume_count(native_rays(rays), native_space(space), counts)
    return counts


class Marched:
    """One lot of rays through a field, in a space. At most a ``share`` of the samples that have a gradient hand it on,
    of density and of colour each, drawn by importance (``core/importance_sampling.py``).

    Once its way back is gone it lets go of its samples: the next step's shall not lie beside them.
    """

    def __init__(
        self,
        rays: Rays,
        space: Space,
        shift: float,
        source: FieldSource,
        background: Float[Tensor, "3"],
        share: float = 1.0,
        with_way_back: bool = False,
    ):
        self.background, self.share, self.with_way_back = background.contiguous(), share, with_way_back
        through = MarchedRays.of(rays, space, shift)
        source.march(through)
        shown_offsets = _ends(through.shown)
        # Where some hand nothing on, their units would be kept in vain; of halves it was not measured.
        keeps = with_way_back and share == 1 and not multiplies_halves()
        colors = source.shade(through, _shown(through, shown_offsets), keeps)
        self.color, self.alpha, self.depth = torch.empty(len(rays), 3), through.alpha, through.depth
        _kernels.volume_blend(
            through.offsets, shown_offsets, through.weights, SHOWN_WEIGHT, colors, self.alpha, self.background,
            self.color,
        )  # fmt: skip
        self._parts = (source, through, shown_offsets, colors) if with_way_back else None

    def rendering(self) -> Rendering:
        """As a record."""
        buffers = {"alpha": self.alpha[:, None], "depth": self.depth[:, None]}
        if not self.with_way_back:
            return Rendering(self.color, buffers["alpha"], buffers)
        return Rendering(self.color, buffers["alpha"], buffers, backward=self._backward)

    def _backward(self, grad_color: Tensor, grad_buffers: Mapping[str, Tensor]) -> Gradients:
        if self._parts is None:
            raise RuntimeError("the way back of these rays has been gone already; march them again")
        (source, of, shown_offsets, colors), self._parts = self._parts, None
        grad_colors, grad_density = torch.empty_like(colors), torch.empty_like(of.weights)
        of_alpha, of_depth = (
            None if (found := grad_buffers.get(name)) is None else found.contiguous() for name in ("alpha", "depth")
        )
        _kernels.volume_unblend(
            of.offsets, shown_offsets, list(of.samples), SHOWN_WEIGHT, colors, self.background,
            grad_color.contiguous(), of_alpha, of_depth, grad_colors, grad_density,
        )  # fmt: skip
        rows, of_rows = drawn_rows(grad_density[:, None], self.share)
        of_colors = drawn_rows(grad_colors, self.share)

        def go_back_density() -> Mapping[str, Tensor]:
            return source.density_gradients(rows, of_rows[:, 0])

        def go_back_color() -> Mapping[str, Tensor]:
            return source.color_gradients(*of_colors)

        device, at_once = of.alpha.device, source.ways_back_at_once
        pair = go_back_density, go_back_color
        gradients = Gradients()
        for named in both(*pair, device) if at_once else (go_back() for go_back in pair):
            gradients.add_all(named)
        return gradients


def _shown(through: MarchedRays, shown_offsets: Int[Tensor, "O"]) -> ShownSamples:
    samples = (through.weights > SHOWN_WEIGHT).nonzero()[:, 0].int()
    numbers = torch.arange(len(through.rays), dtype=torch.int32)
    return ShownSamples(samples, torch.repeat_interleave(numbers, shown_offsets.diff()))


def drawn_rows(gradient: Float[Tensor, "N C"], share: float) -> tuple[Int32[Tensor, "D"], Float[Tensor, "D C"]]:
    """Rows that hand their gradient on, rising, and what each hands on."""
    rows, weights = torch.empty(len(gradient), dtype=torch.int32), torch.empty(len(gradient))
    count = _kernels.volume_draw(gradient, share, rows, weights)
    rows = rows[:count]
    return rows, gradient.index_select(0, rows) * weights[:count, None]


def room_for_units(rows: int, units: int) -> Float[Tensor, "2 N H"] | None:
    """For the units of both hidden layers; None for more than MOST_KEPT of them."""
    return torch.empty(2, rows, units) if 2 * rows * units <= MOST_KEPT else None


def native_rays(rays: Rays) -> tuple[Tensor, Tensor, Tensor]:
    """As the kernels take them."""
    return rays.origins.contiguous(), rays.directions.contiguous(), rays.jitter.contiguous()


def native_space(space: Space) -> tuple[list[float], Tensor, float, int]:
    """As the kernels take it."""
    corners = [*space.box.flatten().tolist(), *space.occupied_box.flatten().tolist()]
    return corners, space.occupied.contiguous().view(torch.int8), space.step, space.most


def _ends(counts: Int[Tensor, "R"]) -> Int[Tensor, "O"]:
    ends = torch.zeros(len(counts) + 1, dtype=torch.int64)
    torch.cumsum(counts, 0, out=ends[1:])
    return ends
