"""How much light a rough surface reflects under an even sky: the second half of the split-sum approximation.

Karis (Real Shading in Unreal Engine 4, 2013) splits the integral of the environment times the BRDF. What the BRDF alone
reflects is linear in the reflectance k at normal incidence, with Schlick's Fresnel term k + (1 - k)(1 - v.h)^5:

    integral over l of f(v, l) (n.l) = k F0 + F1

F0 and F1 depend on n.v and the roughness r only. Microfacets are those of GGX (Walter et al. 2007), a = r^2, masked and
shadowed by Smith's separable term.
"""

import math
from functools import lru_cache

import torch
from jaxtyping import Float
from torch import Tensor

TABLE_NODES = 64
"""Cosines and roughnesses, evenly spaced from 0 to 1 with both ends: linear between them."""

POLAR, AZIMUTHAL = 128, 32
"""Half vectors that a sum is over: midpoints of the area that microfacets show, and of half a turn, the other half of
which is alike. Four times as many change the table by 4e-4 on the mean, and by 0.01 at grazing angles."""

LEAST_COSINE, LEAST_ROUGHNESS = 1e-3, 1e-3
"""Grazing views and perfect mirrors are limits."""

BLOCK_NODES = 64
"""Pairs of a cosine and a roughness at once, a few megabytes."""


@lru_cache(maxsize=2)
def specular_table(nodes: int = TABLE_NODES) -> Float[Tensor, "2 R C"]:
    """F0 and F1, rows by roughness and columns by n.v."""
    along = torch.linspace(0, 1, nodes, dtype=torch.float64)
    roughness, cosine = (axis.flatten() for axis in torch.meshgrid(along, along, indexing="ij"))
    blocks = zip(cosine.split(BLOCK_NODES), roughness.split(BLOCK_NODES), strict=True)
    return torch.cat([reflected_shares(*block) for block in blocks], -1).view(2, nodes, nodes).float()


def reflected_shares(cosines: Float[Tensor, "P"], roughness: Float[Tensor, "P"]) -> Float[Tensor, "2 P"]:
    """F0 and F1, each a sum over half vectors that are distributed as D(n.h) (n.h), so that D drops out:

    f (n.l) dl = F G D (n.l) / (4 (n.v) (n.l)) 4 (v.h) dh = F G (v.h) / ((n.v) (n.h)) D (n.h) dh
    """
    nv = cosines.clamp_min(LEAST_COSINE)[:, None, None]
    a2 = roughness.clamp_min(LEAST_ROUGHNESS)[:, None, None] ** 4
    share = ((torch.arange(POLAR, dtype=nv.dtype) + 0.5) / POLAR)[None, :, None]
    turn = ((torch.arange(AZIMUTHAL, dtype=nv.dtype) + 0.5) * (math.pi / AZIMUTHAL))[None, None, :]
    nh = ((1 - share) / (1 + (a2 - 1) * share)).sqrt()
    vh = (1 - nv * nv).sqrt() * (1 - nh * nh).clamp_min(0).sqrt() * turn.cos() + nv * nh
    nl = 2 * vh * nh - nv
    seen = (nl > 0) & (vh > 0)
    shown = _unmasked(nv, a2) * _unmasked(nl.clamp_min(LEAST_COSINE), a2) * vh / (nv * nh)
    shown = torch.where(seen, shown, 0.0)
    fresnel = (1 - vh.clamp(0, 1)) ** 5
    return torch.stack([(shown * (1 - fresnel)).mean((1, 2)), (shown * fresnel).mean((1, 2))])


def _unmasked(cosine: Tensor, a2: Tensor) -> Tensor:
    """Smith's share of microfacets that are seen at this cosine, of GGX with a squared ``a2``."""
    return 2 * cosine / (cosine + (a2 + (1 - a2) * cosine * cosine).sqrt())


def looked_up(cosines: Float[Tensor, "N"], roughness: Float[Tensor, "N"]) -> tuple[Tensor, Tensor]:
    """F0 and F1, [N 1] each, linear in the table and differentiable; arguments in [0, 1]."""
    table = specular_table().to(cosines)
    places = torch.stack([cosines, roughness], -1)[None, None] * 2 - 1
    found = torch.nn.functional.grid_sample(table[None], places, padding_mode="border", align_corners=True)
    f0, f1 = found[0, :, 0].T.split(1, -1)
    return f0, f1
