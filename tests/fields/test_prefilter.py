"""Cubemaps blurred by lobes: against plain sums over all texels of a fine map, and against what must hold."""

import math

import numpy as np
import pytest
import torch

from ringlight.color.split_sum import ROUGH_SIDE
from ringlight.fields.cubemap import FACES
from ringlight.fields.prefilter import Level, lobe, mip_sides, prefilter
from ringlight.fields.texel_directions import children, solid_angles, texel_directions

SIDE = 32
MIPS = mip_sides(SIDE, ROUGH_SIDE)


def own_texels(blurred: torch.Tensor, side: int) -> torch.Tensor:
    return blurred.view(FACES, side + 2, side + 2, -1)[:, 1:-1, 1:-1].flatten(0, 2)


def mips_of(faces: torch.Tensor) -> torch.Tensor:
    mips = [faces.view(FACES, SIDE, SIDE, -1).permute(0, 3, 1, 2)]
    for _ in MIPS[1:]:
        mips.append(torch.nn.functional.avg_pool2d(mips[-1], 2))
    return torch.cat([mip.permute(0, 2, 3, 1).flatten(0, 2) for mip in mips])


def test_texels_cover_the_sphere_once():
    for side in (1, 2, 16):
        assert solid_angles(side).sum().item() == pytest.approx(4 * math.pi)
    whole = solid_angles(16)[children(8)].sum(-1)
    torch.testing.assert_close(whole, solid_angles(8))
    nearest = (texel_directions(8) @ texel_directions(16).T).argmax(0)
    assert torch.equal(children(8)[nearest].eq(torch.arange(len(nearest))[:, None]).sum(-1), torch.ones(len(nearest)))


@pytest.mark.parametrize("roughness", [0.3, 0.5, 1.0, None])
def test_a_blurred_map_is_the_mean_over_the_whole_sphere(roughness: float | None):
    """Of a smooth environment; what the lobe's cut and the mips leave out is little."""
    side = SIDE if roughness == 0.3 else ROUGH_SIDE
    there, _ = prefilter(MIPS, (Level(side, roughness),))
    directions = texel_directions(SIDE)
    x, y, z = directions.unbind(-1)
    smooth = torch.stack([0.5 + 0.4 * x, 0.5 + 0.5 * y * z, (3 * z).sin()], -1)
    found = own_texels(there.times(mips_of(smooth.float())), side).double()
    cosines = (texel_directions(side) @ directions.T).numpy()
    weights = torch.from_numpy(lobe(cosines, roughness)) * solid_angles(SIDE)
    expected = weights @ smooth / weights.sum(1, keepdim=True)
    assert (found - expected).abs().max() < 0.06


@pytest.mark.parametrize("roughness", [0.08, 0.5, None])
def test_even_light_stays_even(roughness: float | None):
    there, back = prefilter(MIPS, (Level(16, roughness),))
    torch.testing.assert_close(there.times(torch.ones(back.rows, 1)), torch.ones(there.rows, 1))


def test_the_lobe_of_a_half_vector_is_that_of_ggx():
    angle = 0.7
    a2 = 0.4**4
    half = math.cos(angle / 2) ** 2
    expected = math.cos(angle) * a2 / (math.pi * (half * (a2 - 1) + 1) ** 2)
    assert lobe(np.array([math.cos(angle), -0.1]), 0.4) == pytest.approx([expected, 0.0])


def test_the_way_back_is_the_transpose():
    there, back = prefilter(MIPS, (Level(16, 0.3), Level(8, None)))
    drawn = torch.Generator().manual_seed(1)
    values, gradient = (torch.rand(rows, 3, generator=drawn) for rows in (back.rows, there.rows))
    forward, backward = (there.times(values) * gradient).sum(), (values * back.times(gradient)).sum()
    assert forward.item() == pytest.approx(backward.item(), rel=1e-5)
