"""Where the samples of rays lie, and what they add up to: emission and absorption, in torch.

Max 1995; Mildenhall et al. 2020, equation 3. This is the reference; the kernels are compared with it.
"""

import math
from collections.abc import Callable
from dataclasses import dataclass, replace

import torch
from jaxtyping import Bool, Float, Int, UInt8
from torch import Tensor

from ringlight.core.kernel_limits import VOLUME_SMALLEST_STEP as SMALLEST_STEP
from ringlight.core.rendering import Channels
from ringlight.data.rays import Rays
from ringlight.volume.occupancy import is_occupied

SHOWN_WEIGHT = 1e-4
"""Samples of more weight have a colour; the others are black. They count in alpha like any (TensoRF)."""

END = 1e-4
"""A ray ends where less light than this is left: no later sample could have a colour."""


@dataclass(frozen=True)
class Space:
    """A box of world units, what of it is not empty, and how finely it is sampled: ``step`` world units, at most
    ``most`` samples a ray. ``optical`` is the thickness of one step of density one."""

    box: Float[Tensor, "2 3"]
    occupied_box: Float[Tensor, "2 3"]
    occupied: UInt8[Tensor, "X Y B"]
    step: float
    most: int
    optical: float


def sampled_finer(space: Space, times: float) -> Space:
    """So many times as finely."""
    return replace(space, step=space.step / times, most=math.ceil(space.most * times), optical=space.optical / times)


def entry_and_exit(rays: Rays, box: Float[Tensor, "2 3"]) -> tuple[Float[Tensor, "R"], Float[Tensor, "R"]]:
    """World units along each ray; the exit lies before the entry where it misses the box. Not behind the origin."""
    small = torch.where(rays.directions < 0, -SMALLEST_STEP, SMALLEST_STEP)
    slopes = 1 / torch.where(rays.directions.abs() < SMALLEST_STEP, small, rays.directions)
    sides = (box[:, None] - rays.origins) * slopes
    return sides.amin(0).amax(-1).clamp_min(0), sides.amax(0).amin(-1)


def meets_box(rays: Rays, box: Float[Tensor, "2 3"]) -> Bool[Tensor, "R"]:
    """Whether rays pass through the box."""
    near, far = entry_and_exit(rays, box)
    return far > near


@dataclass(frozen=True)
class Samples:
    """Those in the box that are not known to be empty, ray after ray: ``ray`` and ``number`` in its steps [M],
    ``along`` the ray in world units, and ``places`` in the box's [0, 1]^3."""

    ray: Int[Tensor, "M"]
    number: Int[Tensor, "M"]
    along: Float[Tensor, "M"]
    places: Float[Tensor, "M 3"]


def samples_of(rays: Rays, space: Space) -> Samples:
    """Evenly spaced from where rays enter the box, at their jitter."""
    near, far = entry_and_exit(rays, space.box)
    counts = ((far - near) / space.step - rays.jitter).ceil().clamp(0, space.most)
    numbers = torch.arange(int(counts.max()) if len(counts) else 0, device=near.device)
    ray, number = (numbers < counts[:, None]).nonzero(as_tuple=True)
    along = near[ray] + (number + rays.jitter[ray]) * space.step
    points = rays.origins[ray] + along[:, None] * rays.directions[ray]
    low, high = space.occupied_box
    kept = is_occupied(space.occupied, (points - low) / (high - low))
    low, high = space.box
    return Samples(ray[kept], number[kept], along[kept], (points[kept] - low) / (high - low))


Density = Callable[[Float[Tensor, "N 3"]], Float[Tensor, "N"]]
"""Density per unit of length of places in [0, 1]^3."""

Color = Callable[[Float[Tensor, "N 3"], Float[Tensor, "N 3"]], Float[Tensor, "N 3"]]
"""Colour of places in [0, 1]^3 and directions."""


def marched(rays: Rays, space: Space, density: Density, color: Color, background: Float[Tensor, "3"]) -> Channels:
    """ "color" [R 3] over the background, "alpha" [R 1], and "depth" [R 1]: world units along the ray, times alpha."""
    samples = samples_of(rays, space)
    weights = weights_of(samples, len(rays), space.optical * density(samples.places))
    shown = weights.detach() > SHOWN_WEIGHT
    ray, places = samples.ray[shown], samples.places[shown]
    colors = color(places, rays.directions[ray])
    alpha = _sums(samples.ray, weights[:, None], len(rays))
    seen = _sums(ray, weights[shown, None] * colors, len(rays))
    depth = _sums(samples.ray, (weights * samples.along)[:, None], len(rays))
    return {"color": seen + (1 - alpha) * background, "alpha": alpha, "depth": depth}


def weights_of(samples: Samples, rays: int, thickness: Float[Tensor, "M"]) -> Float[Tensor, "M"]:
    """How much of the light of a ray comes from each sample; zero behind its END."""
    width = int(samples.number.max()) + 1 if len(samples.number) else 0
    dense = thickness.new_zeros(rays, width).index_put((samples.ray, samples.number), thickness)
    before = torch.cat([dense.new_zeros(rays, 1), dense], -1).cumsum(-1)[:, :-1]
    left = (-before[samples.ray, samples.number]).exp()
    return left * -torch.expm1(-thickness) * (left.detach() >= END)


def _sums(ray: Int[Tensor, "M"], values: Float[Tensor, "M C"], rays: int) -> Float[Tensor, "R C"]:
    return values.new_zeros(rays, values.shape[-1]).index_add(0, ray, values)
