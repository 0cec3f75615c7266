"""A volume as a model: a field of density and appearance, a network that makes colour, and what is empty."""

import math
from collections.abc import Mapping, Sequence

import torch
import torch.nn.functional
from jaxtyping import Bool, Float, Int
from torch import Tensor, nn

from ringlight.core.camera import Camera
from ringlight.core.importance_sampling import importance_sampled
from ringlight.core.raw_bytes import raw_bytes
from ringlight.core.rendering import Channels, Rendering
from ringlight.core.want import Want
from ringlight.data.rays import RayBatch, Rays, rays_of
from ringlight.errors import RecipeError
from ringlight.models.contract import Count
from ringlight.volume import looked_for, native_march
from ringlight.volume.contract import Sides, VolumeField
from ringlight.volume.loading import load_resized, refuse_impossible, refuse_uneven
from ringlight.volume.marching import Space, sampled_finer
from ringlight.volume.native_march import FieldSource, Marched, runs_native
from ringlight.volume.occupancy import BITS, everything, is_occupied, packed
from ringlight.volume.pictures import BUFFERS, against_slopes, picture, surface_layers
from ringlight.volume.shading import FeatureShading
from ringlight.volume.torch_march import rendered_in_torch
from ringlight.volume.torch_source import TorchSource

SHIFT = -10.0
"""Added to the field's density before softplus: space begins all but empty (TensoRF)."""

DISTANCE_SCALE, BOX_SIDE = 25.0, 3.0
"""Density counts per 1/25 of the unit of length in which the first box has a longest side of 3: TensoRF's, with boxes
of +-1.5 around the subjects of NeRF-Synthetic."""

STEPS_A_VOXEL = 2
"""Samples on the way through a voxel of average side (TensoRF)."""


class VolumeModel(nn.Module):
    """``box`` [2 3] is what the field covers; ``occupied`` [X Y Z/8] are bits of cells over ``occupied_box`` that are
    not known to be empty; ``unit`` is the world's length of one unit of density. ``field`` and ``shading`` are its
    parts. Nothing is counted by rows: the grid's resolution changes as a whole."""

    box: Tensor
    occupied_box: Tensor
    occupied: Tensor
    unit: Tensor
    row_prefixes: tuple[str, ...] = ()
    resized_prefixes: tuple[str, ...] = ("field.", "occupied")
    note: str | None = None
    gradient_share: float = 1.0
    """In :meth:`predict` at most this share of the samples that have a gradient hand it on, drawn by importance."""
    in_torch: bool = False
    """Whether the reference marches where kernels could."""

    def __init__(self, field: VolumeField, shading: FeatureShading, box: Float[Tensor, "2 3"]):
        super().__init__()
        assert isinstance(field, nn.Module)
        self.field, self.shading = field, shading
        box = box.float()
        self.register_buffer("box", box.clone())
        self.register_buffer("occupied_box", box.clone())
        self.register_buffer("occupied", everything())
        self.register_buffer("unit", (box[1] - box[0]).max() / BOX_SIDE)

    @property
    def device(self) -> torch.device:
        """Where it lies."""
        return next(self.parameters()).device

    @property
    def renderer(self) -> str:
        """What draws it."""
        return "cpu ray marcher" if self._is_native else "ray marcher in torch"

    @property
    def _is_native(self) -> bool:
        return not self.in_torch and runs_native(self.field, self.shading)

    def space(self) -> Space:
        """Where rays are sampled, and how finely: by the average voxel of the grid as it is now."""
        lengths = (self.box[1] - self.box[0]).tolist()
        pitches = [length / count for length, count in zip(lengths, self.field.intervals, strict=True)]
        step = sum(pitches) / len(pitches) / STEPS_A_VOXEL
        most = math.ceil(math.hypot(*lengths) / step) + 1
        optical = DISTANCE_SCALE * step / self.unit.item()
        return Space(self.box, self.occupied_box, self.occupied, step, most, optical)

    def density(self, places: Float[Tensor, "N 3"], share: float = 1.0) -> Float[Tensor, "N"]:
        """Of places in the box's [0, 1]^3, per ``unit`` / DISTANCE_SCALE. Of a gradient the field gets a ``share``."""
        found = importance_sampled(self.field.density(places)[:, None], share)[:, 0]
        return torch.nn.functional.softplus(found + SHIFT)

    def density_values(self, places: Float[Tensor, "N 3"]) -> Float[Tensor, "N"]:
        """The same without a graph, by the kernel where it applies; none in cells that rays skip."""
        found = self._source(False).density_values(places) if self._is_native else self.field.density(places).detach()
        return torch.where(self.is_kept(places), torch.nn.functional.softplus(found + SHIFT), 0)

    def is_kept(self, places: Float[Tensor, "N 3"]) -> Bool[Tensor, "N"]:
        """Whether rays do not skip the cells at these places of the box's [0, 1]^3."""
        low, high = self.occupied_box
        return is_occupied(self.occupied, (self.box[0] - low + places * (self.box[1] - self.box[0])) / (high - low))

    def meets_something(self, rays: Rays) -> Bool[Tensor, "R"]:
        """Whether rays pass through a cell that is not known to be empty; on the CPU."""
        return self._samples_in(self.looked_through(), rays) > 0

    def samples_of(self, rays: Rays, finer: float = 1.0) -> Int[Tensor, "R"]:
        """How many of each lie in cells that are not known to be empty, in a grid so many times as fine; on the CPU."""
        return self._samples_in(sampled_finer(self.space(), finer), rays)

    def looked_through(self) -> Space:
        """As :meth:`space`, and as finely as cells lie: steps of a coarse grid pass thin parts by."""
        space = self.space()
        low, high = self.occupied_box
        x, y, bytes_along = self.occupied.shape
        pitch = ((high - low) / torch.tensor((x, y, bytes_along * BITS)).to(low)).mean().item()
        return sampled_finer(space, max(STEPS_A_VOXEL * space.step / pitch, 1.0))

    def color(self, places: Float[Tensor, "N 3"], directions: Float[Tensor, "N 3"]) -> Float[Tensor, "N 3"]:
        """Of places in the box's [0, 1]^3, seen along unit directions; in (0, 1)."""
        shaded: Tensor = self.shading(self.field.appearance(places), directions)
        return shaded

    def predict(self, batch: RayBatch, want: Want, buffers: Sequence[str] = ()) -> Rendering:
        """See :class:`ringlight.models.contract.Model`."""
        return self._rendered(batch.rays.to(self.device), batch.background.to(self.box), want, self.gradient_share)

    def render(
        self, camera: Camera, background: Float[Tensor, "3"], want: Want = Want.EXACT, buffers: Sequence[str] = ()
    ) -> Rendering:
        """See :class:`ringlight.models.contract.Model`; "depth" is along the camera's axis, times alpha."""

        def rendered(rays: Rays) -> Rendering:
            return self._rendered(rays, background.to(self.box), want)

        return picture(rendered, camera, rays_of(camera).to(self.device), want)

    def layers(self, camera: Camera) -> Channels:
        """Its colour over black as "base"; "residual" is zero, for no part of it is split off; "normal" is against the
        gradient of density, in world axes."""
        shown = self.render(camera, torch.zeros(3))
        slopes = against_slopes(self.density, self.box, self.space(), rays_of(camera).to(self.device))
        return surface_layers(shown, slopes)

    def features(self, camera: Camera, background: Float[Tensor, "3"]) -> None:
        """None: its network is no light that could collapse."""

    def refuse_unblended(self, buffers: Sequence[str], who: str) -> None:
        """See :class:`ringlight.models.contract.Model`."""
        for name in buffers:
            if name not in BUFFERS:
                raise RecipeError(f"{who} looks at {name!r}, which a volume does not blend; it blends alpha, depth")

    def counted(self) -> Count:
        """Of the grid that its factors stand for."""
        return Count(math.prod(self.field.sides), "voxels")

    def bytes_each(self) -> int:
        """Of parameters, at least one."""
        total = sum(parameter.numel() * parameter.element_size() for parameter in self.parameters())
        return max(total // self.counted().number, 1)

    def rendering_tensors(self) -> dict[str, Tensor]:
        """All of it."""
        return dict(self.state_dict())

    def rendering_size(self) -> tuple[Count, int]:
        """See :class:`ringlight.models.contract.Model`."""
        return self.counted(), sum(raw_bytes(tensor) for tensor in self.state_dict().values())

    @torch.no_grad()
    def load_tensors(self, tensors: Mapping[str, Tensor]) -> None:
        """Of any resolution. Raises KeyError for a missing or unknown name, ValueError for shapes that do not fit and
        for what no box, length or grid has."""
        load_resized(self, tensors, self.resized_prefixes)
        refuse_impossible(tensors)
        refuse_uneven(self.field)

    def splats(self) -> None:
        """None: nothing is splatted."""

    def solid(self) -> "VolumeModel":
        """Itself."""
        return self

    @property
    def nodes(self) -> Sides:
        """Of its grid."""
        return self.field.sides

    @property
    def intervals(self) -> Sides:
        """See :class:`ringlight.models.contract.Solid`."""
        return self.field.intervals

    @property
    def surface_density(self) -> float:
        """See :class:`ringlight.models.contract.Solid`."""
        return math.log(2) / (STEPS_A_VOXEL * self.space().optical)

    def refine(self, voxels: float) -> None:
        """The grid gets about so many voxels."""
        self.field.resize(self.field.fitting(self.box, voxels))

    def skip_all_but(self, occupied: Bool[Tensor, "X Y Z"]) -> None:
        """From now on rays skip the other cells of the box. Z is a multiple of eight."""
        self.occupied, self.occupied_box = packed(occupied.cpu()).to(self.box.device), self.box.clone()

    def _samples_in(self, space: Space, rays: Rays) -> Int[Tensor, "R"]:
        count = native_march.samples_in if self._is_native else looked_for.samples_in
        return count(space, rays.to(self.device))

    def _rendered(self, rays: Rays, background: Float[Tensor, "3"], want: Want, share: float = 1.0) -> Rendering:
        space = self.space()
        if self._is_native:
            with_way_back = want is Want.GRADIENTS
            source = self._source(with_way_back)
            return Marched(rays, space, SHIFT, source, background, share, with_way_back).rendering()

        def density(places: Tensor) -> Tensor:
            return self.density(places, share)

        def color(places: Tensor, directions: Tensor) -> Tensor:
            return importance_sampled(self.color(places, directions), share)

        return rendered_in_torch(rays, space, density, color, background, dict(self.named_parameters()), want)

    def _source(self, with_way_back: bool) -> FieldSource:
        own: FieldSource | None = self.field.kernels(self.shading)
        return own or TorchSource(self.field, self.shading, with_way_back)
