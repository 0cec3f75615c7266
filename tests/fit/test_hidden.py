"""What lies hidden: who counts as hidden, and that it goes with the last round of dropping alone."""

from dataclasses import replace
from typing import Literal

import pytest
import torch

from ringlight.color.basis_opacities import BasisOpacities
from ringlight.color.harmonics import SphericalHarmonics
from ringlight.core.camera import Camera
from ringlight.core.gaussians import Gaussians
from ringlight.core.rendering import Rendering
from ringlight.fit.optimizer import Optimizer
from ringlight.fit.rates import Adam, Rate
from ringlight.fit.strategies.densify_settings import DensifySettings
from ringlight.fit.strategies.drop_least import DropLeast
from ringlight.fit.strategies.hidden import seen_shares
from ringlight.models.splats import SplatModel
from ringlight.rasterize.choose import rasterizer_for
from ringlight.shade.passthrough import PassThrough

SIZE = 64
AHEAD = Camera(torch.eye(4), (64.0, 64.0), (32.0, 32.0), SIZE, SIZE)
NOTHING = Rendering(torch.zeros(SIZE, SIZE, 3), torch.zeros(SIZE, SIZE, 1))
WHITE = torch.ones(3)


def model_of(means: list[list[float]], scales: list[float], opacities: list[float], kind: str) -> SplatModel:
    count, drawn = len(means), torch.Generator().manual_seed(2)
    appearance = {"sh_dc": torch.zeros(count, 3)}
    if kind == "basis":
        appearance["basis_weights"] = 0.2 * torch.randn(count, 2, generator=drawn)
    else:
        appearance["sh_rest"] = torch.zeros(count, 15, 3)
    table = Gaussians(
        torch.tensor(means),
        torch.tensor(scales).log()[:, None].repeat(1, 3),
        torch.tensor([1.0, 0.0, 0.0, 0.0]).repeat(count, 1),
        torch.tensor(opacities).logit(),
        appearance,
    )
    color = BasisOpacities(2, seed=1) if kind == "basis" else SphericalHarmonics()
    return SplatModel(table, color, PassThrough(), rasterizer_for("cpu"))


@pytest.mark.parametrize("kind", ["harmonics", "basis"])
def test_what_nothing_hides_is_seen_alike_near_and_far_and_what_hangs_behind_a_wall_is_not(kind: str):
    """One behind the camera, and one beside the picture, are seen by none."""
    open_sight = [[-0.8, 0.0, 4.0], [8.0, -14.0, 40.0], [-0.8, 0.8, 4.0]]
    elsewhere = [[0.0, 0.0, -3.0], [90.0, 0.0, 4.0]]
    behind, wall = [[0.6, 0.0, 5.0]], [[0.36, 0.0, 3.0]]
    model = model_of(
        open_sight + elsewhere + behind + wall,
        [0.08, 0.8, 0.08, 0.1, 0.1, 0.08, 0.3],
        [0.9, 0.9, 0.2, 0.9, 0.9, 0.9, 0.999],
        kind,
    )
    seen = seen_shares(model, [AHEAD, AHEAD])
    assert seen.shape == (7,)
    torch.testing.assert_close(seen[1], seen[0], rtol=0.35, atol=0)
    torch.testing.assert_close(seen[2], seen[0], rtol=0.6, atol=0)
    assert seen[3:5].tolist() == [0.0, 0.0]
    assert seen[5] < 0.2 * seen[:3].min()
    assert not seen.requires_grad


def counts_and_depths(
    drop_hidden: float, kind: Literal["adaptive", "mcmc"] = "adaptive"
) -> tuple[list[int], list[float]]:
    """Of ten small ones side by side and a larger one behind them, after each step, and in the end."""
    row = [[0.22 * (index - 5), 0.0, 3.0] for index in range(10)]
    model = model_of([*row, [0.0, 0.0, 3.2]], [0.12] * 10 + [0.3], [0.99] * 10 + [0.9], "harmonics")
    optimizer = Optimizer(model, {"*": Adam(Rate.constant(0.0))}, steps=100)
    settings = DensifySettings(kind=kind, begin=0, every=1, drop_share=1e-6, drop_hidden=drop_hidden)
    dropping, counts = DropLeast(replace(settings, max_gaussians=11), [AHEAD], 100, WHITE, seed=0), []
    dropping.kept = 1.0
    for step in range(1, 101):
        dropping.update(step, model, optimizer, NOTHING)
        counts.append(len(model))
    return counts, model.columns["means"][:, 2].tolist()


def test_hidden_ones_go_with_the_last_round_alone():
    counts, depths = counts_and_depths(0.1)
    assert counts.count(11) == max(DensifySettings(begin=0, every=1, drop_share=1e-6).drop_rounds(100)) - 1
    assert counts[-1] == 10
    assert depths == [3.0] * 10


def test_none_go_where_none_are_to_or_the_number_is_exact():
    assert counts_and_depths(0.0)[0] == [11] * 100
    assert counts_and_depths(0.1, kind="mcmc")[0] == [11] * 100
