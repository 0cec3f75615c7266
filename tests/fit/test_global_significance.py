"""Global significance against the sum that it stands for, fragment by fragment, and who is dropped by it."""

import math

import pytest
import torch

from ringlight.color.harmonics import SphericalHarmonics
from ringlight.core.camera import Camera
from ringlight.core.gaussians import Gaussians
from ringlight.core.rendering import Rendering
from ringlight.fit.optimizer import Optimizer
from ringlight.fit.rates import Adam, Rate
from ringlight.fit.strategies.drop_insignificant import DropInsignificant
from ringlight.fit.strategies.global_significance import area_over_falloff, global_significance, volume_factor
from ringlight.models.splats import SplatModel
from ringlight.rasterize.convention import EPS2D, MIN_ALPHA
from ringlight.rasterize.reference import ReferenceRasterizer
from ringlight.shade.passthrough import PassThrough

SIZE, FOCAL = 128, 100.0
AHEAD = Camera(torch.eye(4), (FOCAL, FOCAL), (64.0, 64.0), SIZE, SIZE)


def model_of(depths: list[float], opacities: list[float], width: float = 0.1) -> SplatModel:
    """Balls in a line from the camera, each as wide on the picture as the others: ``width`` at depth 1."""
    count, depth = len(depths), torch.tensor(depths)
    table = Gaussians(
        torch.stack([torch.zeros(count), torch.zeros(count), depth], 1),
        (width * depth).log()[:, None].repeat(1, 3),
        torch.tensor([1.0, 0.0, 0.0, 0.0]).repeat(count, 1),
        torch.tensor(opacities).logit(),
        {"sh_dc": torch.zeros(count, 3), "sh_rest": torch.zeros(count, 15, 3)},
    )
    return SplatModel(table, SphericalHarmonics(), PassThrough(), ReferenceRasterizer())


def hits_by_fragment(opacities: list[float], width: float = 0.1) -> torch.Tensor:
    """Opacity times transmittance over the pixels that each ball of ``model_of`` hits, the nearest first."""
    across = torch.arange(SIZE).double() + 0.5 - SIZE / 2
    square = across[:, None] ** 2 + across[None, :] ** 2
    through, found = torch.ones(SIZE, SIZE, dtype=torch.float64), []
    for opacity in opacities:
        alpha = opacity * (-0.5 * square / ((FOCAL * width) ** 2 + EPS2D)).exp()
        hit = alpha >= MIN_ALPHA
        found.append((hit * opacity * through).sum())
        through = torch.where(hit, through * (1 - alpha), through)
    return torch.stack(found)


@pytest.mark.parametrize("opacity", [0.99, 0.5, 0.1, 0.02])
def test_alone_it_is_opacity_times_the_pixels_hit(opacity: float):
    found = global_significance(model_of([2.0], [opacity]), [AHEAD], 0.0)
    assert float(found[0]) == pytest.approx(float(hits_by_fragment([opacity])[0]), rel=0.02)


def test_behind_a_faint_one_it_is_near_to_the_sum_over_fragments():
    opacities = [0.1, 0.8]
    found = global_significance(model_of([2.0, 3.0], opacities), [AHEAD], 0.0).double()
    torch.testing.assert_close(found, hits_by_fragment(opacities), rtol=0.05, atol=0)


def test_pictures_add_up():
    model = model_of([2.0, 3.0, 4.0], [0.3, 0.8, 0.5])
    once, thrice = (global_significance(model, [AHEAD] * count, 0.1) for count in (1, 3))
    torch.testing.assert_close(thrice, 3 * once)


def test_a_footprint_that_vanishes_is_as_large_as_its_falloff():
    found = area_over_falloff(torch.tensor([1e-9, MIN_ALPHA, 1.0]))
    assert found[:2].tolist() == pytest.approx([1.0, 1.0], abs=1e-3)
    assert float(found[2]) == pytest.approx(math.log(255) / (1 - 1 / 255))


def test_volumes_count_by_their_power_up_to_the_large_ones():
    scales = torch.arange(1.0, 12.0)[:, None].repeat(1, 3)  # the ninth part of ten: 10
    table = Gaussians(torch.zeros(11, 3), scales.log(), torch.zeros(11, 4), torch.zeros(11))
    found = volume_factor(table, 0.1)
    torch.testing.assert_close(found, ((scales[:, 0] / 10) ** 0.3).clamp_max(1))
    assert volume_factor(table, 0.0).eq(1).all()


@pytest.mark.parametrize(("rounds", "counts"), [((2,), [10, 4, 4]), ((1, 3), [6, 6, 4])])
def test_a_share_goes_in_rounds(rounds: tuple[int, ...], counts: list[int]):
    """Sixty percent: sqrt(0.4) is kept each time."""
    model = model_of([2.0 + index for index in range(10)], [0.5] * 10)
    optimizer = Optimizer(model, {"*": Adam(Rate.constant(0.0))}, steps=3)
    strategy = DropInsignificant(rounds, 0.6, lambda rows, step: global_significance(rows, [AHEAD], 0.1))
    found = []
    for step in range(1, 4):
        strategy.update(step, model, optimizer, Rendering(torch.zeros(SIZE, SIZE, 3), torch.zeros(SIZE, SIZE, 1)))
        found.append(len(model))
    assert found == counts
    assert model.columns["means"][:, 2].tolist() == [2.0, 3.0, 4.0, 5.0]  # what lies behind them is hidden
