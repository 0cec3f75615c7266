from dataclasses import replace

import pytest
import torch

from in_bfloat16 import IN_BFLOAT16
from ringlight import _kernels
from ringlight.color.drawable import drawable_rows
from ringlight.color.light_fields import FIELDS
from ringlight.color.ringlight import RingLight
from ringlight.color.ringlight_settings import RingLightSettings
from ringlight.core.camera import Camera
from ringlight.core.directions import view_directions
from ringlight.core.gaussians import Gaussians
from ringlight.core.scene import PointCloud
from ringlight.core.sh_basis import GREY, sh_basis
from ringlight.core.want import Want
from ringlight.errors import RecipeError
from ringlight.fields.ring_settings import PerceptronSettings, RingSettings, VectorMatrixSettings
from ringlight.files.bake import bake_to_sh
from torch_graph import channels

RING = RingSettings(rank=4, features=6, bands=3, view_bands=2, head_hidden=16, position_nodes=32, view_nodes=8)
SMALL = RingLightSettings(ring=RING, render_hidden=16, modulation_hidden=12)
LATENT = replace(SMALL, latents=4)
FOLLOWED = {"position_gradients": True}
OTHER = {"modulation_as": "factor", "clamp_colors": False}
BOX = torch.tensor([[-1.0, -1.2, -0.9], [1.1, 1.0, 1.3]])


def camera() -> Camera:
    pose = torch.eye(4)
    pose[2, 3] = 4.0
    return Camera(pose, (60.0, 60.0), (32.0, 32.0), 64, 64)


def table(model: RingLight, count: int = 200, seed: int = 0, spread: float = 0.5) -> Gaussians:
    generator = torch.Generator().manual_seed(seed)
    positions = torch.randn(count, 3, generator=generator) * spread
    columns = model.new_columns(PointCloud(positions, torch.rand(count, 3, generator=generator)))
    appearance = {name: column.requires_grad_() for name, column in columns.items()}
    return Gaussians(positions, torch.full((count, 3), -4.0), torch.randn(count, 4), torch.zeros(count), appearance)


def test_new_columns_reproduce_the_colours():
    model = RingLight(SMALL, BOX)
    colors = torch.tensor([[0.0, 1.0, 0.5], [0.25, 0.75, 0.1]])
    columns = model.new_columns(PointCloud(torch.zeros(2, 3), colors))
    assert set(columns) == {"base", "mask_logits"}
    back = columns["base"].sigmoid()
    assert torch.equal((back * 255).round(), (colors * 255).round())
    torch.testing.assert_close(back[1], colors[1])
    assert columns["mask_logits"].tolist() == [1.0, 1.0]


def test_new_latents_are_small_distinct_and_decided_by_the_seed():
    points = PointCloud(torch.zeros(500, 3), torch.full((500, 3), 0.5))
    drawn, again, other = (RingLight(LATENT, BOX, seed).new_columns(points)["latents"] for seed in (1, 1, 2))
    assert drawn.shape == (500, 4)
    assert drawn.is_contiguous()
    assert torch.equal(drawn, again)
    assert not torch.equal(drawn, other)
    assert abs(drawn.mean()) < 0.01
    assert 0.09 < drawn.std() < 0.11


def test_latents_leave_the_other_columns_and_the_wanted_rows_alone():
    points = PointCloud(torch.zeros(50, 3), torch.full((50, 3), 0.5))
    plain, latent = RingLight(SMALL, BOX).new_columns(points), RingLight(LATENT, BOX).new_columns(points)
    assert latent.keys() - plain.keys() == {"latents"}
    assert all(torch.equal(latent[name], column) for name, column in plain.items())
    model = RingLight(LATENT, BOX)
    assert model.wanted(table(model)).all()
    assert "latents" not in model.training_columns, "rendering needs them"


def test_warm_up_shows_the_base_colour_and_leaves_the_field_alone():
    model = RingLight(LATENT, BOX)
    model.lit.fill_(False)
    gaussians = table(model)
    rgb = channels(model, gaussians, camera())["rgb"]
    assert torch.equal(rgb, gaussians.appearance["base"].sigmoid())
    rgb.sum().backward()
    assert gaussians.appearance["latents"].grad is None
    assert all(parameter.grad is None for parameter in model.parameters())
    layers = model.layers(gaussians, camera())
    assert not layers["residual"].any()
    assert not layers["modulation"].any()


def test_rows_outside_the_frustum_keep_their_base_colour():
    model = RingLight(SMALL, BOX)
    gaussians = table(model, spread=3.0)
    rgb = channels(model, gaussians, camera())["rgb"]
    base = gaussians.appearance["base"].sigmoid()
    behind = camera().depths(gaussians.means) < 0
    assert behind.any()
    torch.testing.assert_close(rgb[behind], base[behind], rtol=0, atol=1e-6)
    rgb[behind].sum().backward()
    assert all(parameter.grad is None or not parameter.grad.any() for parameter in model.parameters())


@pytest.mark.parametrize("evaluation", ["tabulated", "exact"])
@pytest.mark.parametrize("light_modulation", [True, False])
@pytest.mark.parametrize("latents", [0, 3, 4])
def test_every_parameter_learns(evaluation, light_modulation, latents):
    chosen = RingLightSettings(
        ring=RING,
        render_hidden=16,
        modulation_hidden=12,
        evaluation=evaluation,
        light_modulation=light_modulation,
        latents=latents,
    )
    model = RingLight(chosen, BOX)
    gaussians = table(model)
    emitted = channels(model, gaussians, camera())
    (emitted["rgb"].square().sum() + emitted["opacity_factor"].sum()).backward()
    for name, parameter in model.named_parameters():
        assert parameter.grad is not None, name
        assert parameter.grad.any(), name
    for name, column in gaussians.appearance.items():
        assert column.grad is not None, name
        assert column.grad.any(), name


@pytest.mark.parametrize("field", FIELDS)
def test_every_field_lights_and_learns(field):
    chosen = replace(SMALL, field=field, mlp=PerceptronSettings(hidden=12), vm=VectorMatrixSettings(side=8), latents=2)
    model = RingLight(chosen, BOX)
    gaussians = table(model)
    rgb = channels(model, gaussians, camera())["rgb"]
    (rgb.square().sum()).backward()
    for name, parameter in model.named_parameters():
        assert name.split(".")[0] in (field, "shading")
        assert parameter.grad is not None, name
        assert parameter.grad.any(), name
    with torch.no_grad():
        in_bfloat16 = _kernels.isa() in ("avx512_bf16", "avx512_amx")
        expected = model.reference(gaussians, camera()).color
        torch.testing.assert_close(rgb, expected, rtol=0, atol=2e-3 if in_bfloat16 else 1e-5)


@pytest.mark.parametrize("field", ["ring", "cp"])
def test_without_base_colour_the_residual_is_added_to_grey(field):
    model = RingLight(replace(SMALL, base_color=False, field=field), BOX)
    gaussians = table(model)
    assert "base" not in gaussians.appearance
    rgb = channels(model, gaussians, camera())["rgb"]
    rgb.square().sum().backward()
    assert all(parameter.grad is not None and parameter.grad.any() for parameter in model.parameters())
    layers = model.layers(gaussians, camera())
    assert torch.equal(layers["base"], torch.full_like(rgb, 0.5))
    torch.testing.assert_close(rgb.detach(), (0.5 + layers["residual"]).clamp(0, 1), rtol=0, atol=1e-6)


def test_as_a_factor_the_modulation_weighs_the_residual_and_nothing_else():
    """The network does not see it, so the layer is its tanh times the modulation."""
    model = RingLight(replace(LATENT, modulation_as="factor"), BOX)
    assert model.shading.render[0].in_features == RING.features + 3 + LATENT.latents
    gaussians = table(model)
    before = model.layers(gaussians, camera())
    shown = before["residual"].abs().amax(1) > 1e-4
    with torch.no_grad():
        model.shading.modulation[2].weight.zero_()
        model.shading.modulation[2].bias.fill_(-60.0)
    after = model.layers(gaussians, camera())
    assert shown.any()
    assert after["residual"].abs().max() < 1e-12
    colors = model.emit(gaussians, camera(), ("rgb",), Want.EXACT).channels
    torch.testing.assert_close(colors, after["base"], rtol=0, atol=1e-6)


@pytest.mark.parametrize("evaluation", ["tabulated", "exact"])
def test_colours_that_are_not_clamped_leave_the_range_and_keep_their_gradient(evaluation):
    found = {}
    for clamps in (True, False):
        model = RingLight(replace(SMALL, clamp_colors=clamps, evaluation=evaluation), BOX)
        with torch.no_grad():
            model.shading.render[4].bias.fill_(2.0)
        gaussians = table(model)
        found[clamps] = channels(model, gaussians, camera())["rgb"]
        found[clamps].sum().backward()
        learned = gaussians.appearance["base"].grad.amax(1) > 0
        layers = model.layers(gaussians, camera())
        beyond = (layers["base"] + layers["residual"]).amin(1) > 1
        assert 0 < beyond.sum() < len(gaussians)
        assert learned[beyond].all() == (not clamps)
        assert learned[beyond].any() == (not clamps)
    assert torch.equal(found[False].clamp(0, 1), found[True])
    assert found[False].max() > 1.2


@pytest.mark.parametrize("light", [SMALL, replace(SMALL, modulation_as="factor", clamp_colors=False)])
def test_layers_add_up_to_the_colour(light):
    model = RingLight(light, BOX)
    gaussians = table(model)
    rgb = model.emit(gaussians, camera(), ("rgb",), Want.EXACT).channels
    layers = model.layers(gaussians, camera())
    total = layers["base"] + layers["residual"]
    torch.testing.assert_close(rgb, total.clamp(0, 1) if light.clamp_colors else total, rtol=0, atol=1e-6)
    assert ((layers["modulation"] >= 0) & (layers["modulation"] <= 1)).all()


def test_baking_sees_the_latents():
    """The bake hands over chunks of rows: each comes with its own latents."""
    model = RingLight(LATENT, BOX)
    gaussians = table(model, 40)
    with torch.no_grad():
        gaussians.appearance["latents"].mul_(30)
    cameras = [replace(camera(), center=(32.0 + shift, 32.0)) for shift in range(5)]
    baked = bake_to_sh(gaussians, cameras, lambda rows, view: model.emit(rows, view, ("rgb",), Want.EXACT).channels)
    rgb = model.emit(gaussians, camera(), ("rgb",), Want.EXACT).channels
    basis = sh_basis(view_directions(gaussians.means, camera().position), 3)
    shown = torch.einsum("nk,nkc->nc", basis, torch.cat([baked.sh_dc[:, None], baked.sh_rest], 1)) + GREY
    torch.testing.assert_close(shown, rgb, rtol=0, atol=0.01)


@pytest.mark.parametrize("evaluation", ["tabulated", "exact"])
def test_positions_follow_the_light_where_the_settings_say_so(evaluation):
    """By the field and by the direction of view: finite differences of the emitted colours."""
    light = replace(SMALL, position_gradients=True, evaluation=evaluation, clamp_colors=False, mask=False)
    model = RingLight(light, BOX).double()
    gaussians = Gaussians.from_columns({name: c.detach().double() for name, c in table(model, 6).columns().items()})

    def colors(means):
        return model.reference(replace(gaussians, means=means), camera()).color

    assert torch.autograd.gradcheck(colors, gaussians.means.clone().requires_grad_(), eps=1e-7, atol=1e-5)
    moved = replace(gaussians, means=gaussians.means.clone().requires_grad_())
    channels(model, moved, camera())["rgb"].sum().backward()
    (expected,) = torch.autograd.grad(colors(moved.means).sum(), moved.means)
    assert expected.abs().max() > 1e-4
    torch.testing.assert_close(moved.means.grad, expected)


def test_positions_are_left_alone_unless_the_settings_say_so():
    for evaluation in ("tabulated", "exact"):
        model = RingLight(replace(SMALL, evaluation=evaluation), BOX)
        gaussians = table(model)
        moved = replace(gaussians, means=gaussians.means.clone().requires_grad_())
        channels(model, moved, camera())["rgb"].sum().backward()
        assert moved.means.grad is None or not moved.means.grad.any()


def test_positions_outside_the_box_are_clamped():
    model = RingLight(SMALL, BOX)
    points = model.unit_points(torch.tensor([[-1.0, -1.2, -0.9], [1.1, 1.0, 1.3], [50.0, -50.0, 0.2]]))
    torch.testing.assert_close(points[:2], torch.tensor([[-1.0] * 3, [1.0] * 3]))
    torch.testing.assert_close(points[2], torch.tensor([1.0, -1.0, 0.0]))


def test_tables_are_kept_while_nothing_changes_and_follow_every_change():
    model = RingLight(SMALL, BOX)
    gaussians = table(model)
    for want in (Want.EXACT, Want.PICTURE):
        first = model.tables(want)
        assert model.tables(want) is first
        assert model.tables(Want.GRADIENTS) is not first
        before = model.emit(gaussians, camera(), ("rgb",), want).channels
        # Through numpy: torch's version counter does not see it.
        model.ring.core.detach().numpy()[:] *= -3.0
        assert model.tables(want) is not first
        after = model.emit(gaussians, camera(), ("rgb",), want).channels
        fresh = RingLight(SMALL, BOX)
        fresh.load_state_dict(model.state_dict())
        torch.testing.assert_close(after, fresh.emit(gaussians, camera(), ("rgb",), want).channels)
        assert not torch.equal(before, after)


@pytest.mark.parametrize(
    "light", [{}, {"mask": True}, {"latents": 4}, {"evaluation": "exact"}, {"field": "mlp"}, OTHER, FOLLOWED]
)
@pytest.mark.parametrize("lit", [True, False])
def test_any_wish_gives_the_same_bits(light: dict[str, object], lit: bool):
    model = RingLight(replace(SMALL, **light), BOX)
    model.lit.fill_(lit)
    gaussians = table(model, spread=3.0)
    found = [model.emit(gaussians, camera(), ("rgb",), want) for want in (Want.EXACT, *Want)]
    exact = found[0]
    reached = drawable_rows(gaussians, camera()).long()  # rows that no pixel shows are nobody's
    assert 0 < len(reached) < len(gaussians)
    # Positions get gradients from torch, which knows no bfloat16.
    near = 1e-4 if IN_BFLOAT16 and lit and light is FOLLOWED else 0.0
    for other in found[1:]:
        torch.testing.assert_close(other.channels[reached], exact.channels[reached], rtol=0, atol=near)
        assert (other.opacity_factor is None) == (exact.opacity_factor is None)
        assert exact.opacity_factor is None or torch.equal(other.opacity_factor, exact.opacity_factor)


def test_settings_that_cannot_work_are_refused():
    for latents in (-1, 17):
        with pytest.raises(RecipeError, match=f"latents is {latents}"):
            RingLightSettings(latents=latents)
    with pytest.raises(RecipeError, match="mask_threshold"):
        RingLightSettings(mask_threshold=1.0)
    with pytest.raises(RecipeError, match=r"ring\.rank"):
        RingSettings(rank=0)
