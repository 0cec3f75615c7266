"""What Gaussians emit for deferred reflection shading: a base colour, a normal, latents and a depth."""

from collections.abc import Mapping

import torch
from jaxtyping import Bool, Float
from torch import Tensor, nn

from ringlight import _kernels
from ringlight.color.mirror_kernel import kernel_takes, mirror_channels, mirror_view
from ringlight.color.ringlight import BASE, DARKEST, LATENT_SPREAD, LATENTS
from ringlight.core.camera import Camera
from ringlight.core.directions import normalize, view_directions
from ringlight.core.gaussians import Gaussians
from ringlight.core.gradients import Gradient
from ringlight.core.kernel_limits import MIRROR_MAX_LATENTS
from ringlight.core.randomness import generator
from ringlight.core.rendering import Channels
from ringlight.core.scene import PointCloud

NORMALS = "normals"

FLIP_BELOW = -0.25
"""Cosine between normal and direction to the camera below which a normal is turned round. At 0 normals at silhouettes
jump there and back between views; never turned, those of backs blend with those of fronts."""


def lit_widths(latents: int) -> dict[str, int]:
    """What is blended once the shader is lit, in order."""
    return {"rgb": 3, "normal": 3, "latents": latents, "depth": 1}


class Mirror(nn.Module):
    """Channels that a shader turns into colour once per pixel; nothing here depends on light.

    Columns: ``base`` [N 3], the base colour's logit; ``normals`` [N 3], world, of any length, learned freely;
    ``latents`` [N L]. Buffer: ``lit``, False during the warm-up, when only base colours are blended.
    """

    lit: Tensor
    training_columns: tuple[str, ...] = ()

    def __init__(self, latents: int, seed: int = 0):
        super().__init__()
        self.latents, self._seed = latents, seed
        self.register_buffer("lit", torch.tensor(True))

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
            LATENTS: LATENT_SPREAD * noise.to(points.colors),
        }

    def channels(self, gaussians: Gaussians, camera: Camera) -> Channels:
        """ "rgb" [N 3] in [0, 1]; once lit also "normal" [N 3], unit, world, "latents" [N L] and "depth" [N 1], the
        camera's z in world units."""
        base, normals, latents = (gaussians.appearance[name] for name in (BASE, NORMALS, LATENTS))
        if not self.lit:
            return {"rgb": base.sigmoid()}
        if not kernel_takes(gaussians.means, base, normals, latents):
            return self.twin(gaussians, camera)
        channels = mirror_channels(gaussians.means, base, normals, latents, camera, FLIP_BELOW)
        widths = lit_widths(latents.shape[1])
        return dict(zip(widths, channels.split(tuple(widths.values()), -1), strict=True))

    def direct(self) -> "DirectMirror | None":
        """The same without autograd, by the kernel; None where it takes no so many latents."""
        return DirectMirror(self.lit, self.latents) if self.latents <= MIRROR_MAX_LATENTS else None

    def twin(self, gaussians: Gaussians, camera: Camera) -> Channels:
        """What the kernel computes once lit, in torch and in any precision."""
        return {
            "rgb": gaussians.appearance[BASE].sigmoid(),
            "normal": facing_normals(gaussians, camera),
            "latents": gaussians.appearance[LATENTS],
            "depth": camera.depths(gaussians.means)[:, None],
        }

    @torch.no_grad()
    def layers(self, gaussians: Gaussians, camera: Camera) -> Channels:
        """ "base" [N 3] and "normal" [N 3], without gradient."""
        return {"base": gaussians.appearance[BASE].sigmoid(), "normal": facing_normals(gaussians, camera)}

    @torch.no_grad()
    def wanted(self, gaussians: Gaussians) -> Bool[Tensor, "N"]:
        """Every row."""
        return torch.ones(len(gaussians), dtype=torch.bool, device=gaussians.means.device)


class DirectMirror:
    """One view at a time: :meth:`draw`, then :meth:`differentiate`. Arrays are used again by the next view."""

    widths: Mapping[str, int]
    opacity_factor: Float[Tensor, "N"] | None = None
    late: "_kernels.LazyColors | None" = None

    def __init__(self, lit: Tensor, latents: int):
        self._lit, self._lit_widths = lit, lit_widths(latents)
        self.widths = self._lit_widths
        self._channels = torch.empty(0, 0, dtype=torch.float32, device="cpu")
        self._gradients: list[Tensor] = []

    def draw(self, gaussians: Gaussians, camera: Camera, may_be_late: bool = False) -> Float[Tensor, "N C"]:
        """What :meth:`Mirror.channels` gives, side by side."""
        base, normals, latents = (gaussians.appearance[name] for name in (BASE, NORMALS, LATENTS))
        self.widths = self._lit_widths if self._lit else {"rgb": 3}
        if not self._lit:
            self._channels = base.sigmoid()
            return self._channels
        self._columns = (gaussians.means, base, normals, latents)
        self._view = mirror_view(camera, FLIP_BELOW)
        shape = (len(base), sum(self.widths.values()))
        if self._channels.shape != shape:
            self._channels = base.new_empty(shape)
            self._gradients = [torch.empty_like(column) for column in self._columns]
        _kernels.mirror_channels(self._view, self._columns, self._channels)
        return self._channels

    def differentiate(self, by_channels: Float[Tensor, "N C"], by_geometry: dict[str, Tensor]) -> dict[str, Gradient]:
        """See :class:`ringlight.color.contract.DirectColor`; positions are left alone unless a depth had a gradient."""
        if len(self.widths) == 1:
            return {BASE: torch.ops.aten.sigmoid_backward(by_channels, self._channels)}
        if _kernels.mirror_gradient(self._view, self._columns, by_channels, self._gradients):
            by_geometry["means"] += self._gradients[0]
        return dict(zip((BASE, NORMALS, LATENTS), self._gradients[1:], strict=True))


def facing_normals(gaussians: Gaussians, camera: Camera) -> Float[Tensor, "N 3"]:
    """Unit normals in world coordinates, those that clearly look away from the camera turned round."""
    normals = normalize(gaussians.appearance[NORMALS])
    towards = -view_directions(gaussians.means.detach(), camera.position.to(gaussians.means))
    cosines = (normals.detach() * towards).sum(-1, keepdim=True)
    return torch.where(cosines >= FLIP_BELOW, normals, -normals)
