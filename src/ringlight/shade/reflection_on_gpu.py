"""Reflection shading on a GPU: covered pixels are gathered once, and what the network sees of them is one kernel's."""

import functools
from collections.abc import Sequence
from dataclasses import dataclass

import torch
import triton
from jaxtyping import Float, Int, Int32
from torch import Tensor, nn

from ringlight.core.camera import Camera
from ringlight.core.directions import SMALLEST_LENGTH
from ringlight.core.gradients import SHADER, Gradients
from ringlight.core.rendering import ImageGradients, Shaded
from ringlight.core.want import Want
from ringlight.fields.parallax import SMALLEST_HALF_CHORD_SQUARED
from ringlight.shade.covered import FAINTEST_SHADED, SHORTEST_NORMAL
from ringlight.shade.reflection_kernel import reads_depth
from ringlight.shade.reflection_settings import ReflectionSettings
from ringlight.shade.reflection_triton import LAUNCH, ROWS, SPHERE, read_surface, read_surface_gradient

MOST_PROGRAMS = 512
"""Of the way back; each has a slab of gradients of the spheres and of the factors of the place."""

COLOR = 3
"""Channels of a colour, the first ones."""


@dataclass(frozen=True)
class LitSurface:
    """What shades a view. ``parameters`` are the shader's in the kernels' order: maps of all shells, spheres and axes
    if there are such, ``mlp``; ``names`` are theirs. ``box`` [low, high] is the scene's, world units."""

    settings: ReflectionSettings
    box: Float[Tensor, "2 3"]
    parameters: Sequence[Tensor]
    names: Sequence[str]
    mlp: nn.Module

    @torch.no_grad()
    def shade(
        self,
        image: Float[Tensor, "H W C"],
        alpha: Float[Tensor, "H W 1"],
        camera: Camera,
        background: Float[Tensor, "3"],
        want: Want,
    ) -> Shaded:
        """As ``ReflectionShader.shade``. Parameters that ask for no gradient get none."""
        pixels = _Pixels(self, image, alpha, camera, background)
        seen = pixels.inputs().requires_grad_(want is Want.GRADIENTS)
        with torch.set_grad_enabled(want is Want.GRADIENTS):
            added = self.mlp(seen)
        color = image[..., :COLOR].clone(memory_format=torch.contiguous_format)
        color.view(-1, COLOR).index_add_(0, pixels.index, added.detach() * pixels.opacities)
        if want is not Want.GRADIENTS:
            return Shaded(color)

        @torch.no_grad()
        def backward(grad_color: Float[Tensor, "H W 3"], into: Gradients) -> ImageGradients:
            by_color = grad_color.reshape(-1, COLOR).index_select(0, pixels.index)
            learned = [parameter for parameter in self.mlp.parameters() if parameter.requires_grad]
            by_seen, *by_mlp = torch.autograd.grad(added, [seen, *learned], by_color * pixels.opacities)
            found, by_image, by_alpha = pixels.gradients(seen, by_seen, added, by_color, grad_color)
            asking = [
                name for name, parameter in zip(self.names, self.parameters, strict=True) if parameter.requires_grad
            ]
            given = [
                gradient for gradient, parameter in zip(found, self.parameters, strict=False) if parameter.requires_grad
            ]
            into.add_all(dict(zip((SHADER + name for name in asking), [*given, *by_mlp], strict=True)))
            return by_image, by_alpha

        return Shaded(color, backward)

    @property
    def levels(self) -> Sequence[Float[Tensor, "_ _ F"]]:
        """Of the maps of all shells."""
        return self.parameters[: self.settings.shells * len(self.settings.sides)]

    @property
    def spheres(self) -> Float[Tensor, "S 4"] | None:
        """One for each shell, if there is parallax."""
        return self.parameters[len(self.levels)] if self.settings.parallax else None

    @property
    def axes(self) -> Float[Tensor, "3 K D"] | None:
        """The factors of the place, if there are such."""
        before = len(self.levels) + self.settings.parallax
        return self.parameters[before] if self.settings.axis_nodes else None

    @property
    def frame(self) -> tuple[float, float, float, float]:
        """The middle of the box, and the inverse of half its longest side."""
        low, high = self.box.tolist()
        longest = max(above - below for below, above in zip(low, high, strict=True))
        x, y, z = (0.5 * (below + above) for below, above in zip(low, high, strict=True))
        return x, y, z, 2 / longest


@functools.cache
def _places(sides: tuple[int, ...], shells: int, features: int, device: torch.device) -> Int32[Tensor, "2 L"]:
    """Of each level its side, and where it begins among the numbers of all. Copied once: copies wait for the GPU."""
    sides = sides * shells
    sizes = [side * side * features for side in sides]
    starts = [sum(sizes[:number]) for number in range(len(sizes))]
    return torch.tensor([sides, starts], dtype=torch.int32, device=device)


class _Pixels:
    """The covered pixels of one view, in the order of the image."""

    def __init__(self, light: LitSurface, image: Tensor, alpha: Tensor, camera: Camera, background: Tensor):
        self.light, self.alpha = light, alpha.contiguous()
        self.image = image if _by_pixel(image) else image.contiguous()
        self.index: Int[Tensor, "P"] = (self.alpha.flatten() > FAINTEST_SHADED).nonzero()[:, 0]
        self.opacities = self.alpha.flatten().index_select(0, self.index)[:, None]
        numbers = [*camera.focal, *camera.center, *camera.world_to_camera[:3, :3].flatten().tolist()]
        numbers += [*camera.position.tolist(), *background.tolist(), *light.frame]
        self.view = torch.tensor(numbers).to(image.device)
        settings = light.settings
        self.places = _places(settings.sides, settings.shells, settings.features, image.device)
        self.maps = torch.cat([level.detach().flatten() for level in light.levels])

    def inputs(self) -> Float[Tensor, "P I"]:
        """What the network sees of each."""
        settings = self.light.settings
        features = len(self.light.levels) * settings.features
        width = 1 + settings.latents + COLOR + features + 3 * settings.raw_direction
        inputs = self.image.new_empty(len(self.index), width)
        if len(self.index):
            read_surface[(triton.cdiv(len(self.index), ROWS),)](
                *self._read(), inputs, *self._numbers(), **self._sizes()
            )
        return inputs

    def gradients(
        self,
        seen: Float[Tensor, "P I"],
        by_seen: Float[Tensor, "P I"],
        added: Float[Tensor, "P 3"],
        by_color: Float[Tensor, "P 3"],
        grad_color: Float[Tensor, "H W 3"],
    ) -> tuple[list[Tensor], Float[Tensor, "H W C"], Float[Tensor, "H W 1"]]:
        """By maps, spheres and axes in this order, by the blended channels and by alpha."""
        light, count = self.light, len(self.index)
        height, width, channels = self.image.shape
        by_image, by_alpha = self.image.new_zeros(height, width, channels), torch.zeros_like(self.alpha)
        by_image[..., :COLOR] = grad_color
        by_maps = torch.zeros_like(self.maps)
        factors = 0 if light.axes is None else light.axes.numel()
        shells = light.settings.shells
        programs = max(min(triton.cdiv(count, ROWS), MOST_PROGRAMS), 1)
        slabs = self.image.new_zeros(programs, shells * SPHERE + factors)
        if count:
            padded = triton.next_power_of_2(max(light.settings.axis_nodes, 1))
            read_surface_gradient[(programs,)](
                *self._read(), seen, by_seen.contiguous(), added, by_color, by_image, by_alpha, by_maps, slabs,
                *self._numbers(), PADDED=padded, **self._sizes(), **LAUNCH,
            )  # fmt: skip
        by_spheres, by_axes = slabs.sum(0).split([shells * SPHERE, factors])
        parts = by_maps.split([level.numel() for level in light.levels])
        found = [part.view_as(level) for part, level in zip(parts, light.levels, strict=True)]
        found += [] if light.spheres is None else [by_spheres.view_as(light.spheres)]
        found += [] if light.axes is None else [by_axes.view_as(light.axes)]
        return found, by_image, by_alpha

    def _read(self) -> tuple[Tensor, ...]:
        unread = self.maps
        spheres, axes = (unread if part is None else part.detach() for part in (self.light.spheres, self.light.axes))
        return self.image, self.alpha, self.index, self.view, self.maps, *self.places, spheres, axes

    def _numbers(self) -> tuple[int | float, ...]:
        width, step = self.image.shape[1], self.image.stride(1)
        return len(self.index), width, step, SHORTEST_NORMAL**2, SMALLEST_HALF_CHORD_SQUARED, SMALLEST_LENGTH

    def _sizes(self) -> dict[str, int]:
        settings = self.light.settings
        return {
            "LATENTS": settings.latents,
            "SHELLS": settings.shells,
            "LEVELS": len(settings.sides),
            "FEATURES": settings.features,
            "WIDE": triton.next_power_of_2(settings.features),
            "PARALLAX": int(settings.parallax),
            "NODES": settings.axis_nodes,
            "DEPTH": int(reads_depth(settings)),
            "RAW": int(settings.raw_direction),
            "B": ROWS,
        }


def _by_pixel(image: Float[Tensor, "H W C"]) -> bool:
    """Whether a pixel's channels lie side by side, and pixels at even steps, row by row."""
    by_line, by_pixel, by_channel = image.stride()
    return by_channel == 1 and by_line == image.shape[1] * by_pixel
