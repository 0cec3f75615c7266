"""Lots of rays through pixels of all photographs: what models learn from that march along rays.

Photographs stay 8 bit in one table of pixels; a ray is worked out of its pixel's camera when it is drawn.
"""

from collections.abc import Callable
from dataclasses import dataclass

import torch
from jaxtyping import Bool, Float, Int
from torch import Tensor

from ringlight.core.camera import Camera
from ringlight.core.directions import normalize
from ringlight.core.randomness import generator
from ringlight.core.scene import Scene, View
from ringlight.core.stages import counted
from ringlight.data.ray_errors import RayErrors

OPAQUE = 255
"""Alpha of a photograph without a mask."""

NOT_BACKGROUND = 0.1
"""Difference of a colour of [0, 1] in any channel from an even background that noise and blur do not make."""

LOOKED_AT_ONCE = 1 << 20
"""Rays that are asked about together where all are: some 30 MB."""


@dataclass(frozen=True)
class Rays:
    """``origins``, world units, and unit ``directions``; ``jitter`` in [0, 1) is where samples lie in their steps."""

    origins: Float[Tensor, "R 3"]
    directions: Float[Tensor, "R 3"]
    jitter: Float[Tensor, "R"]

    def __len__(self) -> int:
        return len(self.origins)

    def to(self, device: torch.device) -> "Rays":
        """The same on a device."""
        return Rays(self.origins.to(device), self.directions.to(device), self.jitter.to(device))

    def part(self, begin: int, end: int) -> "Rays":
        """Those from ``begin`` up to ``end``."""
        return Rays(self.origins[begin:end], self.directions[begin:end], self.jitter[begin:end])


MIDDLE = 0.5
"""Where samples lie in their steps when a picture is drawn."""


def rays_of(camera: Camera) -> Rays:
    """Through all pixel centres of a camera, row by row."""
    directions = normalize(camera.ray_directions().reshape(-1, 3))
    origins = camera.position.expand(len(directions), 3).contiguous()
    return Rays(origins, directions, torch.full((len(directions),), MIDDLE))


CHANNELS = 4
"""Red, green, blue and alpha, a byte each, of every pixel of all photographs: they stay in memory."""

CHOOSING = 4
"""Bytes of a ray while it is said which are drawn: the flag, a padded copy, and both of what packs these to bits."""


@dataclass(frozen=True)
class RayBatch:
    """R rays of any photographs; ``colors`` are those of their pixels over ``background``, in [0, 1]. Rays that were
    not drawn evenly have ``weights`` in a mean over them."""

    rays: Rays
    colors: Float[Tensor, "R 3"]
    background: Float[Tensor, "3"]
    weights: Float[Tensor, "R"] | None = None

    @property
    def label(self) -> str:
        """What a message calls it."""
        return f"a lot of {len(self.rays):,} rays"


class RayBatches:
    """``count`` rays drawn anew at each step, with replacement; a pure function of (seed, step), of what is kept, and,
    where a share is drawn ``by_error``, of the errors so far.

    Up to step ``varied`` photographs with masks lie over a background that is drawn, as with a random one: over black,
    what is black itself, as all but empty space is, would never be missed.
    """

    def __init__(self, scene: Scene, count: int, seed: int, varied: int = 0, by_error: float = 0.0):
        self.scene, self.count, self.seed = scene, count, seed
        self.varied = varied if all(view.has_alpha for view in scene.train) else 0
        cameras = [view.camera for view in scene.train]
        self._ends = torch.tensor([camera.width * camera.height for camera in cameras]).cumsum(0)
        self._widths = torch.tensor([camera.width for camera in cameras])
        self._lenses = torch.tensor([[*camera.focal, *camera.center] for camera in cameras])
        self._rotations = torch.stack([camera.world_to_camera[:3, :3] for camera in cameras])
        self._positions = torch.stack([camera.position for camera in cameras])
        self._pixels = torch.empty(int(self._ends[-1]), CHANNELS, dtype=torch.uint8)
        begin = 0
        for view, end in zip(counted("reading photographs", scene.train), self._ends.tolist(), strict=True):
            self._pixels[begin:end] = _pixels(view)
            begin = end
        self._kept: Int[Tensor, "K"] | None = None
        heights = torch.tensor([camera.height for camera in cameras])
        self.errors = RayErrors(self._widths, heights, by_error) if by_error else None
        self._last: tuple[int, Int[Tensor, "R"], Float[Tensor, "R 3"]] | None = None

    @property
    def all_rays(self) -> int:
        """Rays through every pixel."""
        return len(self._pixels)

    @property
    def kept_rays(self) -> int:
        """Those that are drawn from."""
        if self.errors is not None:
            return self.errors.kept_rays
        return self.all_rays if self._kept is None else len(self._kept)

    @staticmethod
    def bytes_of(pixels: int) -> int:
        """The most that photographs of so many pixels take: their channels, and of each ray its number and, while rays
        are chosen, whether it is drawn, a few times over. Tables of blocks, which draws by error need, take less than
        those."""
        return pixels * (CHANNELS + _number_type(pixels).itemsize + CHOOSING)

    @property
    def bytes_kept(self) -> int:
        """Of pixels, and of the numbers of kept rays or of which ones blocks have."""
        kept = 0 if self._kept is None else self._kept.numel() * self._kept.element_size()
        return self._pixels.numel() + kept + (0 if self.errors is None else self.errors.bytes_kept)

    def at(self, step: int) -> RayBatch:
        """The batch of ``step`` (1 is the first)."""
        draw = generator(self.seed, step, "rays")
        index, weights, blocks = self._drawn(draw)
        jitter = torch.rand(self.count, generator=draw)
        background = self._background(step)
        pixels = self._pixels[index].float().div_(OPAQUE)
        colors = torch.lerp(background.expand(self.count, 3), pixels[:, :3], pixels[:, 3:])
        self._last = None if blocks is None else (step, blocks, colors)
        return RayBatch(self._rays(index, jitter), colors, background, weights)

    def _drawn(self, draw: torch.Generator) -> tuple[Int[Tensor, "R"], Tensor | None, Tensor | None]:
        """Numbers of rays, and their weights and blocks."""
        if self.errors is not None:
            drawn = self.errors.draw(self.count, draw)
            return drawn.index, drawn.weights, drawn.blocks
        index = torch.randint(self.kept_rays, (self.count,), generator=draw)
        return (index if self._kept is None else self._kept[index].long()), None, None

    def learn(self, step: int, colors: Float[Tensor, "R 3"]) -> None:
        """What was shown of the lot of ``step``, if that is the last one and was drawn by error; forgotten then."""
        if self._last is None or self.errors is None or self._last[0] != step:
            return
        _, blocks, truth = self._last
        self.errors.learn(blocks, (colors.detach().cpu() - truth).square().mean(-1))
        self._last = None

    def looked_at(self, meets: Callable[[Rays], Bool[Tensor, "R"]]) -> Bool[Tensor, "P"]:
        """Of all rays those of which ``meets`` says so; their samples are in the middle of their steps."""
        found = torch.empty(self.all_rays, dtype=torch.bool)
        for begin in range(0, self.all_rays, LOOKED_AT_ONCE):
            index = torch.arange(begin, min(begin + LOOKED_AT_ONCE, self.all_rays))
            found[begin : begin + len(index)] = meets(self.through(index))
        return found

    def shows_subject(self) -> Bool[Tensor, "P"]:
        """Of all rays those of pixels that show more than the background: the mask is opaque there, or, in photographs
        without one, the colour is not that of the scene's background."""
        found = torch.empty(self.all_rays, dtype=torch.bool)
        masked, background = all(view.has_alpha for view in self.scene.train), self.scene.background_color
        for begin in range(0, self.all_rays, LOOKED_AT_ONCE):
            pixels = self._pixels[begin : begin + LOOKED_AT_ONCE]
            if masked:
                found[begin : begin + len(pixels)] = pixels[:, 3] == OPAQUE
            else:
                apart = (pixels[:, :3].float() / OPAQUE - background).abs().amax(-1)
                found[begin : begin + len(pixels)] = apart > NOT_BACKGROUND
        return found

    def through(self, index: Int[Tensor, "R"]) -> Rays:
        """Rays by their numbers; their samples are in the middle of their steps."""
        return self._rays(index, torch.full((len(index),), MIDDLE))

    def keep(self, chosen: Bool[Tensor, "P"]) -> None:
        """From now on draw from the ``chosen`` ones of all rays alone."""
        if self.errors is not None:
            self.errors.keep(chosen)
            return
        self._kept = None  # before others are made
        kept = torch.empty(int(chosen.sum()), dtype=_number_type(self.all_rays))
        end = 0
        for begin, part in zip(range(0, len(chosen), LOOKED_AT_ONCE), chosen.split(LOOKED_AT_ONCE), strict=True):
            rows = part.nonzero()[:, 0] + begin  # of all rays together these would be 64 bits each
            kept[end : end + len(rows)] = rows
            end += len(rows)
        self._kept = kept

    def _rays(self, index: Int[Tensor, "R"], jitter: Float[Tensor, "R"]) -> Rays:
        view = torch.searchsorted(self._ends, index, right=True)
        first = torch.where(view > 0, self._ends[(view - 1).clamp_min(0)], 0)
        row = torch.div(index - first, self._widths[view], rounding_mode="floor")
        column = index - first - row * self._widths[view]
        lenses = self._lenses[view]
        pixel = torch.stack([column, row], -1) + 0.5
        on_plane = (pixel - lenses[:, 2:]) / lenses[:, :2]
        of_camera = torch.cat([on_plane, torch.ones_like(on_plane[:, :1])], -1)
        directions = (of_camera[:, None, :] @ self._rotations[view])[:, 0]
        return Rays(self._positions[view], normalize(directions), jitter)

    def _background(self, step: int) -> Float[Tensor, "3"]:
        if self.scene.background != "random" and step > self.varied:
            return self.scene.background_color
        return torch.rand(3, generator=generator(self.seed, step, "background"))


def _pixels(view: View) -> Tensor:
    """Red, green, blue and alpha [P 4], 8 bit."""
    pixels = torch.from_numpy(view.load())
    if pixels.shape[-1] == 3:
        pixels = torch.cat([pixels, torch.full_like(pixels[..., :1], OPAQUE)], -1)
    return pixels.reshape(-1, 4)


def _number_type(rays: int) -> torch.dtype:
    """What holds the number of any of so many."""
    return torch.int32 if rays <= torch.iinfo(torch.int32).max else torch.int64
