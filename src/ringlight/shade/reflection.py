"""Deferred shading: what a surface reflects, computed once per pixel from blended normals, latents and depth.

Shading blended normals instead of blending shaded colours is what makes splatted reflections sharp (3DGS-DR, Ye et al.
2024). The residual colour is a small network's of the surface and of octahedral features in the reflected direction,
which a learned sphere corrects for parallax.
"""

from collections.abc import Mapping

import torch
from jaxtyping import Float
from torch import Tensor, nn

from ringlight import _kernels
from ringlight.core.camera import Camera
from ringlight.core.directions import octahedral_from_directions, reflect, view_directions
from ringlight.core.gradients import SHADER, Gradients
from ringlight.core.importance_sampling import importance_sampled
from ringlight.core.light_features import LightFeatures, evenly, flat_tanh
from ringlight.core.randomness import generator
from ringlight.core.rendering import Channels, ImageGradients, KeptTiles, Shaded, TileGradients, TileShading
from ringlight.core.want import Want
from ringlight.fields.axis_factors import AxisFactors
from ringlight.fields.diagonal_ring import DiagonalRing
from ringlight.fields.networks import perceptron
from ringlight.fields.octahedral import OctahedralMaps
from ringlight.fields.parallax import sphere_exits
from ringlight.fields.ring_tables import tabulated_features
from ringlight.fields.tensor_ring import TensorRing
from ringlight.shade.by_torch import shaded_by_torch
from ringlight.shade.covered import CoveredPixels, covered_pixels
from ringlight.shade.passthrough import unchanged
from ringlight.shade.reflection_kernel import (
    ReflectionJob,
    fits_triton,
    kernel_takes,
    plane_gradients,
    planes_of,
    reads_depth,
    reflection_job,
    shaded_planes,
    tile_gradients,
)
from ringlight.shade.reflection_settings import FIRST_LOG_INVERSE_RADII, ReflectionSettings
from ringlight.shade.tile_order import tile_by_tile

RINGS: dict[str, type[TensorRing]] = {"full": TensorRing, "diagonal": DiagonalRing}
"""By the setting ``ring``."""

# The last layer starts smaller than PyTorch's: the first shaded picture shall be near that of the base colours.
FIRST_LAST_LAYER = 0.3


class ReflectionShader(nn.Module):
    """color = rgb + alpha * mlp(cosine, latents, base, features, direction), at pixels that are opaque enough.

    Channels: "rgb" 3, "normal" 3 (world, outwards, blended unit vectors), "latents" L and, if it is read, "depth" 1
    (camera z).
    Parameters: ``mlp``; ``maps.s``, the octahedral maps of shell s; ``sphere`` [shells 4] if there is parallax, see
    ``fields/parallax.py``, in a frame where the longest side of the scene's box is [-1, 1]; ``places``, factors of the
    features in the same frame, and ``ring``, if there are such.
    Buffers: ``box`` [low, high], world units; ``lit``, False during the warm-up, when "rgb" is the colour.
    """

    box: Tensor
    lit: Tensor
    adds_light = True

    def __init__(self, settings: ReflectionSettings, box: Float[Tensor, "2 3"], seed: int = 0):
        super().__init__()
        self.settings = settings
        drawn = generator(seed, 0, "reflection")
        shells = range(settings.shells)
        self.maps = nn.ModuleList(OctahedralMaps(settings.sides, settings.features, drawn) for _ in shells)
        if settings.parallax:
            self.sphere = nn.Parameter(torch.tensor([[0.0, 0.0, 0.0, FIRST_LOG_INVERSE_RADII[s]] for s in shells]))
        features = settings.shells * len(settings.sides) * settings.features
        if settings.axis_nodes:
            self.places = AxisFactors(settings.axis_nodes, features)
        inputs = 1 + settings.latents + 3 + features + 3 * settings.raw_direction
        if settings.ring != "none":
            self.ring = RINGS[settings.ring](settings.near_field, drawn)
            inputs += settings.near_field.features
        self.mlp = perceptron((inputs, *[settings.hidden] * settings.hidden_layers, 3), drawn)
        last = self.mlp[-1]
        assert isinstance(last, nn.Linear)
        with torch.no_grad():
            last.weight.mul_(FIRST_LAST_LAYER)
            last.bias.zero_()
        self.register_buffer("box", box.clone().float())
        # Python reads it, also of a model that is an outline on torch's meta device.
        self.register_buffer("lit", torch.tensor(True, device="cpu"))
        names = {id(parameter): name for name, parameter in self.named_parameters()}
        self._kernel_names = [names[id(parameter)] for parameter in self.kernel_parameters()]

    @property
    def needs(self) -> Mapping[str, int]:
        """Base colours alone during the warm-up; depth where the settings look at it."""
        if not self.lit:
            return {"rgb": 3}
        depth = {"depth": 1} if reads_depth(self.settings) else {}
        return {"rgb": 3, "normal": 3, "latents": self.settings.latents, **depth}

    def tiles(self, camera: Camera, background: Float[Tensor, "3"], want: Want) -> TileShading | None:
        """See :class:`ringlight.shade.contract.Shader`; wide layers may multiply bytes where a picture is wanted."""
        parameters = self.kernel_parameters()
        if not self.lit or not kernel_takes(self.settings, *parameters):
            return None
        job = self.job(camera, background)
        kernel = _kernels.ReflectionPicture(job.shape, parameters, job.view, want is not Want.PICTURE)

        @torch.no_grad()
        def backward(tiles: KeptTiles, grad_color: Tensor, into: Gradients) -> TileGradients:
            gradients = [torch.empty_like(parameter) for parameter in parameters]
            found = tile_gradients(job, tiles, parameters, grad_color, gradients)
            self._add(gradients, into)
            return found

        return TileShading(kernel, backward)

    def _add(self, gradients: list[Tensor], into: Gradients) -> None:
        names = (SHADER + name for name in self._kernel_names)
        into.add_all(dict(zip(names, gradients, strict=True)))

    def shade(
        self,
        image: Float[Tensor, "H W C"],
        alpha: Float[Tensor, "H W 1"],
        camera: Camera,
        background: Float[Tensor, "3"],
        want: Want,
        shaded: Float[Tensor, "H W 3"] | None = None,
    ) -> Shaded:
        """Planar memory, as the rasterizer's; differentiable in "rgb", "normal", "latents", alpha, parameters, and
        in "depth" where the settings say so."""
        if not self.lit:
            return Shaded(image, unchanged)
        if shaded is not None and want is not Want.GRADIENTS:
            return Shaded(shaded)
        if fits_triton(self.settings, image, alpha, *self.kernel_parameters()):
            from ringlight.shade.reflection_on_gpu import LitSurface

            light = LitSurface(self.settings, self.box, self.kernel_parameters(), self._kernel_names, self.mlp)
            return light.shade(image, alpha, camera, background, want)
        if not kernel_takes(self.settings, image, alpha):
            return self.shaded_by_torch(image, alpha, camera, background, want)
        return self._shaded_by_kernel(image, alpha, camera, background, want, shaded)

    @torch.no_grad()
    def _shaded_by_kernel(
        self,
        image: Float[Tensor, "H W C"],
        alpha: Float[Tensor, "H W 1"],
        camera: Camera,
        background: Float[Tensor, "3"],
        want: Want,
        color: Float[Tensor, "H W 3"] | None,
    ) -> Shaded:
        job, parameters = self.job(camera, background), self.kernel_parameters()
        if color is None:
            color = shaded_planes(job, planes_of(job, image, alpha), parameters)
        if want is not Want.GRADIENTS:
            return Shaded(color)

        @torch.no_grad()
        def backward(grad_color: Tensor, into: Gradients) -> ImageGradients:
            gradients = [torch.empty_like(parameter) for parameter in parameters]
            block, grad_alpha = plane_gradients(job, image, alpha, parameters, grad_color, gradients)
            self._add(gradients, into)
            return block.permute(1, 2, 0), grad_alpha.permute(1, 2, 0)

        return Shaded(color, backward)

    def shaded_by_torch(
        self,
        image: Float[Tensor, "H W C"],
        alpha: Float[Tensor, "H W 1"],
        camera: Camera,
        background: Float[Tensor, "3"],
        want: Want,
    ) -> Shaded:
        """As :meth:`shade`, by :meth:`reference` and torch's autograd."""
        names, widths = zip(*self.needs.items(), strict=True)

        def color(image: Tensor, alpha: Tensor) -> Tensor:
            buffers = dict(zip(names, image.split(widths, -1), strict=True)) | {"alpha": alpha}
            return self.reference(buffers, camera, background)

        parameters = {SHADER + name: parameter for name, parameter in self.named_parameters()}
        return shaded_by_torch(color, image, alpha, parameters, want)

    def reference(
        self, buffers: Channels, camera: Camera, background: Float[Tensor, "3"], gradient_share: float = 1.0
    ) -> Float[Tensor, "H W 3"]:
        """What the kernel computes, in torch and in any precision. Here ``gradient_share`` saves no time."""
        pixels = covered_pixels(buffers, camera, background, self.settings.depth_gradient)
        if gradient_share < 1:  # lots are laid end to end in this order
            pixels = pixels.chosen(tile_by_tile(pixels.index, camera.height, camera.width))
        added = importance_sampled(pixels.alpha * self._added(pixels), gradient_share)
        rgb = buffers["rgb"]
        residual = rgb.new_zeros(3, rgb[..., 0].numel()).index_copy(1, pixels.index, added.T)
        return rgb + residual.unflatten(1, rgb.shape[:2]).permute(1, 2, 0)

    @torch.no_grad()
    def features(self, buffers: Channels, camera: Camera, background: Float[Tensor, "3"]) -> LightFeatures | None:
        """Those of the maps times their factors of the place, which have no range, and those of the ring, if there is
        one, behind their tanh; None during the warm-up."""
        if not self.lit:
            return None
        pixels = covered_pixels(buffers, camera, background, self.settings.depth_gradient)
        pixels = pixels.chosen(evenly(len(pixels.index)).to(pixels.index.device))
        of_maps, *of_ring = seen = self._seen(pixels)
        flat = [torch.zeros_like(of_maps, dtype=torch.bool), *(flat_tanh(values) for values in of_ring)]
        return LightFeatures(torch.cat(seen, -1), torch.cat(flat, -1), self.mlp.hidden(self._inputs(pixels, seen)))

    def emitted(self, channels: Channels, points: Float[Tensor, "N 3"], camera: Camera) -> Float[Tensor, "N 3"]:
        """Each Gaussian's own surface shaded, in [0, 1]: what harmonics can be fitted to."""
        base = channels["rgb"]
        if not self.lit:
            return base
        everyone, opaque = torch.arange(len(base), device=base.device), torch.ones_like(base[:, :1])
        directions = view_directions(points, camera.position.to(points))
        alone = CoveredPixels(everyone, opaque, base, channels["latents"], channels["normal"], directions, points)
        return (base + self._added(alone)).clamp(0, 1)

    def job(self, camera: Camera, background: Float[Tensor, "3"]) -> ReflectionJob:
        """What the kernel is told of a view."""
        return reflection_job(self.settings, camera, background, self.box)

    def kernel_parameters(self) -> list[Tensor]:
        """In the kernel's order."""
        spheres = [self.sphere] if self.settings.parallax else []
        places = [self.places.axes] if self.settings.axis_nodes else []
        return [*self.maps.parameters(), *spheres, *places, *self.mlp.parameters()]

    def _added(self, pixels: CoveredPixels) -> Float[Tensor, "P 3"]:
        """What the network adds to each pixel's base colour where that is opaque."""
        added: Tensor = self.mlp(self._inputs(pixels, self._seen(pixels)))
        return added

    def _seen(self, pixels: CoveredPixels) -> list[Tensor]:
        """Features of what each pixel reflects, [P F] each: the maps', and the ring's if there is one."""
        reflected, points = reflect(pixels.directions, pixels.normals), self._unit_points(pixels.points)
        features = []
        for shell, maps in enumerate(self.maps):
            seen = sphere_exits(points, reflected, self.sphere[shell]) if self.settings.parallax else reflected
            features.append(maps(octahedral_from_directions(seen)))
        found = [torch.cat(features, -1) * (self.places(points) if self.settings.axis_nodes else 1)]
        if self.settings.ring != "none":
            found.append(torch.tanh(tabulated_features(self.ring, points.clamp(-1, 1), reflected)))
        return found

    def _inputs(self, pixels: CoveredPixels, seen: list[Tensor]) -> Float[Tensor, "P I"]:
        """What the network sees of each pixel."""
        of_maps, *of_ring = seen
        cosine = -(pixels.directions * pixels.normals).sum(-1, keepdim=True)
        raw = [pixels.directions] if self.settings.raw_direction else []
        return torch.cat([cosine, pixels.latents, pixels.base, of_maps, *raw, *of_ring], -1)

    def _unit_points(self, points: Float[Tensor, "P 3"]) -> Float[Tensor, "P 3"]:
        """World positions relative to the box's middle, in halves of its longest side: a sphere stays a sphere."""
        low, high = self.box.to(points)
        return (points - 0.5 * (low + high)) * (2 / (high - low).max())
