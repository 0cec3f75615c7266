"""The split sum: its table against another quadrature, and the light that surfaces of each roughness see."""

import math

import pytest
import torch

from ringlight.color.specular_table import reflected_shares, specular_table
from ringlight.color.split_sum import FIRST_LIGHT, SMOOTHEST, SplitSumLight
from ringlight.core.directions import normalize
from ringlight.errors import RecipeError
from ringlight.fields.cubemap import bordered, looked_up


def shares_over_light(cosine: float, roughness: float, count: int = 800) -> tuple[float, float]:
    """F0 and F1 as sums over directions of the light, evenly spaced, rather than over half vectors."""
    polar = (torch.arange(count, dtype=torch.float64) + 0.5) / count * (math.pi / 2)
    turn = (torch.arange(count, dtype=torch.float64) + 0.5) / count * math.pi
    theta, phi = torch.meshgrid(polar, turn, indexing="ij")
    light = torch.stack([theta.sin() * phi.cos(), theta.sin() * phi.sin(), theta.cos()], -1)
    view = torch.tensor([math.sqrt(1 - cosine**2), 0.0, cosine], dtype=torch.float64)
    half = torch.nn.functional.normalize(light + view, dim=-1)
    nh, vh, nl, a2 = half[..., 2], half @ view, light[..., 2], roughness**4
    density = a2 / (math.pi * (nh * nh * (a2 - 1) + 1) ** 2)
    masked = [2 * c / (c + (a2 + (1 - a2) * c * c).sqrt()) for c in (nl, torch.tensor(cosine, dtype=torch.float64))]
    area = 2 * theta.sin() * (math.pi / 2 / count) * (math.pi / count)  # both halves of the turn
    reflected = density * masked[0] * masked[1] / (4 * cosine) * area
    fresnel = (1 - vh) ** 5
    return float((reflected * (1 - fresnel)).sum()), float((reflected * fresnel).sum())


@pytest.mark.parametrize("cosine", [0.15, 0.5, 1.0])
@pytest.mark.parametrize("roughness", [0.3, 0.6, 1.0])
def test_the_table_agrees_with_a_sum_over_the_light(cosine: float, roughness: float):
    f0, f1 = reflected_shares(torch.tensor([cosine]).double(), torch.tensor([roughness]).double())[:, 0].tolist()
    assert (f0, f1) == pytest.approx(shares_over_light(cosine, roughness), abs=8e-3)


def test_a_perfect_mirror_reflects_by_fresnel_alone():
    cosines = torch.tensor([0.1, 0.4, 0.9, 1.0]).double()
    f0, f1 = reflected_shares(cosines, torch.zeros(4).double())
    torch.testing.assert_close(f1, (1 - cosines) ** 5, atol=2e-3, rtol=0)
    torch.testing.assert_close(f0 + f1, torch.ones(4).double(), atol=2e-3, rtol=0)


def test_no_surface_reflects_more_than_it_gets():
    table = specular_table()
    assert table.isfinite().all()
    assert table.min() >= 0
    assert table.sum(0).max() <= 1.001


def light_of(seed: int = 1) -> SplitSumLight:
    light = SplitSumLight(32)
    with torch.no_grad():
        light.texels.copy_(torch.randn(light.texels.shape, generator=torch.Generator().manual_seed(seed)))
    return light


DIRECTIONS = normalize(torch.randn(200, 3, generator=torch.Generator().manual_seed(3)))


def test_the_first_environment_is_even_at_every_roughness():
    light = SplitSumLight(16)
    maps = light.maps()
    for roughness in (0.0, 0.2, 0.7, 1.0):
        seen = light.specular(maps, DIRECTIONS, torch.full((200,), roughness))
        torch.testing.assert_close(seen, torch.full((200, 3), FIRST_LIGHT))
    torch.testing.assert_close(light.diffuse(maps, DIRECTIONS), torch.full((200, 3), FIRST_LIGHT))


def test_a_smooth_mirror_shows_the_environment_and_rough_ones_less_of_it():
    light = light_of()
    maps = light.maps()
    sharp = looked_up(bordered(light.texels.sigmoid()), DIRECTIONS)
    deviations = [light.specular(maps, DIRECTIONS, torch.full((200,), r)).std().item() for r in (0.08, 0.3, 0.5, 1.0)]
    assert deviations == sorted(deviations, reverse=True)
    smooth = light.specular(maps, DIRECTIONS, torch.full((200,), SMOOTHEST))
    assert torch.corrcoef(torch.stack([smooth.flatten(), sharp.flatten()]))[0, 1] > 0.95


def test_between_two_maps_light_is_linear_in_the_roughness():
    light = light_of()
    maps, (low, high) = light.maps(), light.roughness[:2]
    ends = [light.specular(maps, DIRECTIONS, torch.full((200,), r)) for r in (low, high)]
    middle = light.specular(maps, DIRECTIONS, torch.full((200,), (low + high) / 2))
    torch.testing.assert_close(middle, (ends[0] + ends[1]) / 2, atol=1e-5, rtol=0)


@pytest.mark.parametrize("side", [0, 8, 24, 48, 4096])
def test_another_side_is_refused(side: int):
    with pytest.raises(RecipeError, match=f"has {side} texels"):
        SplitSumLight(side)
