"""What Gaussians emit for deferred reflection shading: a base colour, a normal, latents and a depth."""

import torch
from jaxtyping import Bool, Float
from torch import Tensor, nn

from ringlight.color.mirror_kernel import kernel_takes, mirror_channels
from ringlight.color.ringlight import BASE, DARKEST, LATENT_SPREAD, LATENTS
from ringlight.core.camera import Camera
from ringlight.core.directions import normalize, view_directions
from ringlight.core.gaussians import Gaussians
from ringlight.core.randomness import generator
from ringlight.core.rendering import Channels
from ringlight.core.scene import PointCloud

NORMALS = "normals"

FLIP_BELOW = -0.25
"""Cosine between normal and direction to the camera below which a normal is turned round. At 0 normals at silhouettes
jump there and back between views; never turned, those of backs blend with those of fronts."""


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
        widths = (3, 3, latents.shape[1], 1)
        return dict(zip(("rgb", "normal", "latents", "depth"), channels.split(widths, -1), strict=True))

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


def facing_normals(gaussians: Gaussians, camera: Camera) -> Float[Tensor, "N 3"]:
    """Unit normals in world coordinates, those that clearly look away from the camera turned round."""
    normals = normalize(gaussians.appearance[NORMALS])
    towards = -view_directions(gaussians.means.detach(), camera.position.to(gaussians.means))
    cosines = (normals.detach() * towards).sum(-1, keepdim=True)
    return torch.where(cosines >= FLIP_BELOW, normals, -normals)
