"""What Gaussians emit for deferred reflection shading: a base colour, a normal, latents and a depth."""

from collections.abc import Iterable, Mapping, Sequence

import torch
from jaxtyping import Bool, Float
from torch import Tensor, nn

from ringlight import _kernels
from ringlight.color.by_torch import emitted_by_torch
from ringlight.color.ringlight import BASE, LATENT_DEVIATION, LATENTS
from ringlight.core.camera import Camera
from ringlight.core.directions import SMALLEST_LENGTH, normalize, view_directions
from ringlight.core.gaussians import Gaussians
from ringlight.core.gradients import COLUMNS, Gradients
from ringlight.core.kernel_limits import MIRROR_MAX_LATENTS
from ringlight.core.randomness import generator
from ringlight.core.rendering import Channels, Emission
from ringlight.core.scene import DARKEST, PointCloud
from ringlight.core.triton_kernels import runs_triton
from ringlight.core.want import Want

NORMALS = "normals"

FLIP_BELOW = -0.25
"""Cosine between normal and direction to the camera below which a normal is turned round. At 0 normals at silhouettes
jump there and back between views; never turned, those of backs blend with those of fronts."""


class Mirror(nn.Module):
    """Channels that a shader turns into colour once per pixel; nothing here depends on light.

    Columns: ``base`` [N 3], the base colour's logit; ``normals`` [N 3], world, of any length, learned freely;
    ``latents`` [N L]. Emits "rgb" in [0, 1], "normal", unit, world, "latents" and "depth", the camera's z in world
    units.
    """

    training_columns: tuple[str, ...] = ()
    opacity_columns: tuple[str, ...] = ()
    axes_are_normals: bool = False

    def __init__(self, latents: int, seed: int = 0):
        super().__init__()
        self.latents, self._seed = latents, seed
        self.emits: Mapping[str, int] = {"rgb": 3, "normal": 3, "latents": latents, "depth": 1}

    def new_columns(self, points: PointCloud) -> dict[str, Tensor]:
        """Base colours equal to the points', their normals, and latents drawn by the seed.

        Points without normals get those of a ball around their centre.
        """
        count = len(points.positions)
        normals = points.normals
        if normals is None:
            normals = normalize(points.positions - points.positions.mean(0))
        noise = torch.randn(count, self.latents, generator=generator(self._seed, 0, LATENTS))
        return {
            BASE: points.colors.clamp(DARKEST, 1 - DARKEST).logit(),
            NORMALS: normals.clone().contiguous(),
            LATENTS: LATENT_DEVIATION * noise.to(points.colors),
        }

    def emit(self, gaussians: Gaussians, camera: Camera, names: Sequence[str], want: Want) -> Emission:
        """All channels; "rgb" alone where nothing else is asked for."""
        if list(names) == ["rgb"]:
            return _base_emission(gaussians.appearance[BASE], want)
        columns = {"means": gaussians.means} | {name: gaussians.appearance[name] for name in (BASE, NORMALS, LATENTS)}
        if runs_triton(*columns.values()):
            from ringlight.color.basis_emission import emission_of_plain_mirror

            return emission_of_plain_mirror(columns, (FLIP_BELOW, SMALLEST_LENGTH), camera, self.emits, want)
        if self.runs_native(columns.values()):
            return _native_emission(columns, camera, self.emits, want)

        def channels(columns: dict[str, Tensor]) -> Channels:
            return mirror_channels_reference(columns, camera)

        return emitted_by_torch(channels, columns, {}, want)

    def runs_native(self, tensors: Iterable[Tensor]) -> bool:
        """Whether the kernels take them: float32 on the CPU, and no more latents than they know."""
        kinds = {(tensor.dtype, tensor.device.type) for tensor in tensors}
        return kinds == {(torch.float32, "cpu")} and self.latents <= MIRROR_MAX_LATENTS

    @torch.no_grad()
    def layers(self, gaussians: Gaussians, camera: Camera) -> Channels:
        """ "base" [N 3] and "normal" [N 3]."""
        normals = facing_normals(gaussians.means, gaussians.appearance[NORMALS], camera)
        return {"base": gaussians.appearance[BASE].sigmoid(), "normal": normals}

    def features(self, gaussians: Gaussians, camera: Camera) -> None:
        """None: the light is a shader's."""

    @torch.no_grad()
    def wanted(self, gaussians: Gaussians) -> Bool[Tensor, "N"]:
        """Every row."""
        return torch.ones(len(gaussians), dtype=torch.bool, device=gaussians.means.device)

    def harmonics(self, gaussians: Gaussians) -> None:
        """None: the colour is a shader's."""


@torch.no_grad()
def _base_emission(base: Float[Tensor, "N 3"], want: Want) -> Emission:
    colors = base.sigmoid()
    if want is not Want.GRADIENTS:
        return Emission({"rgb": 3}, colors)

    def backward(grad_channels: Tensor, _: Tensor | None, into: Gradients) -> None:
        into.add(COLUMNS + BASE, torch.ops.aten.sigmoid_backward(grad_channels, colors))

    return Emission({"rgb": 3}, colors, backward=backward)


@torch.no_grad()
def _native_emission(columns: dict[str, Tensor], camera: Camera, widths: Mapping[str, int], want: Want) -> Emission:
    view = mirror_view(camera)
    tensors = [column.contiguous() for column in columns.values()]
    channels = tensors[0].new_empty(len(tensors[0]), sum(widths.values()))
    _kernels.mirror_channels(view, tensors, channels)
    if want is not Want.GRADIENTS:
        return Emission(widths, channels)

    def backward(grad_channels: Tensor, _: Tensor | None, into: Gradients) -> None:
        gradients = [torch.empty_like(tensor) for tensor in tensors]
        moved = _kernels.mirror_gradient(view, tensors, grad_channels, gradients)
        for name, gradient in zip(columns, gradients, strict=True):
            if moved or name != "means":  # positions are left alone unless a depth had a gradient
                into.add(COLUMNS + name, gradient)

    return Emission(widths, channels, backward=backward)


def mirror_view(camera: Camera) -> _kernels.MirrorView:
    """What the kernels are told of a view."""
    return _kernels.MirrorView(camera=camera.native, flip_below=FLIP_BELOW, smallest_length=SMALLEST_LENGTH)


def mirror_channels_reference(columns: dict[str, Tensor], camera: Camera) -> Channels:
    """What the kernel computes, in torch and in any precision, from the columns by name."""
    return {
        "rgb": columns[BASE].sigmoid(),
        "normal": facing_normals(columns["means"], columns[NORMALS], camera),
        "latents": columns[LATENTS],
        "depth": camera.depths(columns["means"])[:, None],
    }


def facing_normals(means: Float[Tensor, "N 3"], normals: Float[Tensor, "N 3"], camera: Camera) -> Float[Tensor, "N 3"]:
    """Unit normals in world coordinates, those that clearly look away from the camera turned round."""
    normals = normalize(normals)
    towards = -view_directions(means.detach(), camera.position.to(means))
    cosines = (normals.detach() * towards).sum(-1, keepdim=True)
    return torch.where(cosines >= FLIP_BELOW, normals, -normals)
