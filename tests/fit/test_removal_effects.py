"""What a Gaussian's removal changes: the estimate against pictures without it."""

import dataclasses

import pytest
import torch

from ringlight.color.basis_opacities import BasisOpacities
from ringlight.color.contract import ColorModel
from ringlight.color.glossy_harmonics import GlossyHarmonics
from ringlight.color.harmonics import SphericalHarmonics
from ringlight.color.shared_basis import SharedBasis
from ringlight.core.camera import Camera
from ringlight.core.gaussians import Gaussians
from ringlight.core.rendering import Rendering
from ringlight.core.want import Want
from ringlight.fit.optimizer import Optimizer
from ringlight.fit.rates import Adam, Rate
from ringlight.fit.strategies import removal_effects as removal_effects_file
from ringlight.fit.strategies.blending_weights import blending_weights
from ringlight.fit.strategies.densify_settings import DensifySettings
from ringlight.fit.strategies.drop_least import DropLeast
from ringlight.fit.strategies.removal_effects import drawn_signs, removal_effects
from ringlight.models.splats import SplatModel
from ringlight.rasterize.choose import rasterizer_for
from ringlight.shade.passthrough import PassThrough

SIZE = 8
TURNED = torch.tensor(
    [[0.9, 0.0, 0.43588989, -1.0], [0.0, 1.0, 0.0, 0.1], [-0.43588989, 0.0, 0.9, 0.3], [0.0, 0.0, 0.0, 1.0]]
)
AHEAD = Camera(torch.eye(4), (8.0, 8.0), (4.0, 4.0), SIZE, SIZE)
ASIDE = Camera(TURNED, (8.0, 8.0), (4.0, 4.0), SIZE, SIZE)
WHITE, BLACK = torch.ones(3), torch.zeros(3)
NOTHING = Rendering(torch.zeros(SIZE, SIZE, 3), torch.zeros(SIZE, SIZE, 1))


def color_of(kind: str, count: int, drawn: torch.Generator) -> tuple[ColorModel, dict[str, torch.Tensor]]:
    """A colour model with its columns; of all but harmonics opacities differ between the cameras."""
    dc = torch.randn(count, 3, generator=drawn)
    if kind == "basis":
        model = BasisOpacities(2, seed=1)
        return model, {"sh_dc": dc, "basis_weights": 0.3 * torch.randn(count, 2, generator=drawn)}
    rest = {"sh_dc": dc, "sh_rest": torch.zeros(count, 15, 3)}
    if kind == "harmonics":
        return SphericalHarmonics(), rest
    return GlossyHarmonics(), rest | {"opacity_rest": 0.05 * torch.randn(count, 15, generator=drawn)}


def model_of(seed: int, count: int, kind: str = "harmonics") -> SplatModel:
    """Gaussians of any colour here and there ahead of the camera, some behind others."""
    drawn = torch.Generator().manual_seed(seed)
    depth = 2 + 2 * torch.rand(count, generator=drawn)
    across = (torch.rand(count, 2, generator=drawn) - 0.5) * depth[:, None] * 0.6
    opacities = torch.empty(count).uniform_(0.05, 0.95, generator=drawn)
    color, appearance = color_of(kind, count, drawn)
    table = Gaussians(
        torch.cat([across, depth[:, None]], 1),
        (0.1 * depth).log()[:, None].repeat(1, 3),
        torch.tensor([1.0, 0.0, 0.0, 0.0]).repeat(count, 1),
        opacities.logit(),
        appearance,
    )
    return SplatModel(table, color, PassThrough(), rasterizer_for("cpu"))


def removed(model: SplatModel, camera: Camera, background: torch.Tensor) -> torch.Tensor:
    """The same by drawing a picture without each row."""
    whole, table = model.render(camera, background).color.detach(), model.gaussians
    changes = []
    for row in range(len(model)):
        others = table.rows(torch.arange(len(model)) != row)
        without = SplatModel(others, model.color, model.shader, model.rasterize)
        changes.append((without.render(camera, background).color.detach() - whole).square().sum())
    return torch.stack(changes)


@pytest.mark.parametrize(
    ("kind", "background"), [("harmonics", WHITE), ("harmonics", BLACK), ("basis", BLACK), ("glossy", BLACK)]
)
def test_it_is_the_change_of_each_pixel_where_signs_are_of_one_pixel(kind: str, background: torch.Tensor, monkeypatch):
    model, pixels = model_of(4, count=5, kind=kind), SIZE * SIZE * 3
    factors = [model.color.emit(model.gaussians, camera, ("rgb",), Want.EXACT) for camera in (AHEAD, ASIDE)]
    assert (kind == "harmonics") == (factors[0].opacity_factor is None)
    assert kind == "harmonics" or (factors[0].opacity_factor - factors[1].opacity_factor).abs().max() > 0.1
    chosen = torch.eye(pixels)
    effects = torch.zeros(len(model))
    for pixel in range(pixels):
        sign = chosen[pixel].unflatten(0, (SIZE, SIZE, 3))
        monkeypatch.setattr(removal_effects_file, "drawn_signs", lambda like, drawn, sign=sign: sign)
        effects += removal_effects(model, [AHEAD, ASIDE], background, 0, 1)
    expected = removed(model, AHEAD, background) + removed(model, ASIDE, background)
    torch.testing.assert_close(effects, expected, rtol=1e-3, atol=1e-6)


def test_its_mean_over_draws_is_the_change():
    model, draws = model_of(5, count=6), 300
    estimate = sum(removal_effects(model, [AHEAD], WHITE, 0, step) for step in range(draws)) / draws
    # Six deviations of a mean of so many squares of what is nearly normal.
    torch.testing.assert_close(estimate, removed(model, AHEAD, WHITE), rtol=6 * (2 / draws) ** 0.5, atol=1e-5)


def test_without_a_picture_there_is_no_effect():
    assert removal_effects(model_of(1, count=4), [], WHITE, 0, 1).tolist() == [0.0] * 4


def test_a_row_that_no_picture_shows_changes_nothing():
    model = model_of(2, count=3)
    with torch.no_grad():
        model.columns["means"][1, 2] = -1.0  # behind the camera
        model.columns["opacity_logits"][2] = 90.0  # a float's opacity is one
    effects = removal_effects(model, [AHEAD], WHITE, 0, 1)
    assert effects[1] == 0
    assert effects.isfinite().all()
    with torch.no_grad():
        model.columns["means"][:, 2] = -1.0
    assert removal_effects(model, [AHEAD], WHITE, 0, 1).tolist() == [0.0] * 3


def test_a_row_with_the_colour_of_what_lies_behind_goes_before_a_fainter_one_of_another():
    model = model_of(3, count=2)
    with torch.no_grad():
        model.columns["means"][:] = torch.tensor([[0.0, 0.0, 2.0], [0.5, 0.5, 2.0]])
        model.columns["opacity_logits"][:] = torch.tensor([2.0, -1.0])
        model.columns["sh_dc"][0] = 0.5 / 0.28209479177387814  # white, as the background
        model.columns["sh_dc"][1] = -1.0
    left = {}
    for by in ("weights", "effects"):
        kept = SplatModel(model.gaussians.rows(torch.arange(2)), model.color, model.shader, model.rasterize)
        optimizer = Optimizer(kept, {"*": Adam(Rate.constant(0.0))}, steps=100)
        dropping = DropLeast(DensifySettings(begin=0, every=1, drop_share=0.5, drop_by=by), [AHEAD], 100, WHITE, seed=0)
        for step in range(1, 101):
            dropping.update(step, kept, optimizer, NOTHING)
        left[by] = kept.columns["means"][:, 0].tolist()
    assert left == {"weights": [0.0], "effects": [0.5]}


def test_signs_are_signs_and_the_same_for_the_same_draw():
    like = torch.zeros(50, 40, 3)
    one, same, other = (drawn_signs(like, torch.Generator().manual_seed(seed)) for seed in (1, 1, 2))
    assert one.shape == like.shape
    assert one.unique().tolist() == [-1.0, 1.0]
    assert abs(float(one.mean())) < 0.1
    assert torch.equal(one, same)
    assert not torch.equal(one, other)


def test_blending_weights_are_of_the_opacities_towards_each_camera():
    model = model_of(6, count=5, kind="basis")
    seen = []
    for camera in (AHEAD, ASIDE):
        factor = model.color.emit(model.gaussians, camera, ("rgb",), Want.EXACT).opacity_factor
        baked = dataclasses.replace(model.gaussians, opacity_logits=(model.gaussians.opacities * factor).logit())
        plain = SplatModel(baked, SharedBasis(2), model.shader, model.rasterize)
        seen.append(blending_weights(plain, [camera]))
    torch.testing.assert_close(blending_weights(model, [AHEAD, ASIDE]), seen[0] + seen[1], rtol=1e-4, atol=1e-5)
