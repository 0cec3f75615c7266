"""From a picture's gradient to those of all parameters: the seams add up, and what is drawn stays the same bits."""

import gc
from unittest.mock import patch

import pytest
import torch
from mirrors import WHITE, mirror, view
from torch import Tensor

from ringlight import _kernels
from ringlight.color.basis_opacities import factors_reference
from ringlight.color.varying_mirror import varying_channels_reference
from ringlight.core.camera import Camera
from ringlight.core.gaussians import Gaussians
from ringlight.core.gradients import Gradients, dense
from ringlight.core.rendering import Channels, Emission, Rendering, Shaded
from ringlight.core.want import Want
from ringlight.errors import BackendError, RecipeError
from ringlight.models.splats import SplatModel
from ringlight.models.way_back import ordered
from ringlight.rasterize.contract import RasterOptions
from ringlight.rasterize.cpu_job import Job, table_of
from ringlight.rasterize.reference import ReferenceRasterizer, blended
from ringlight.shade.passthrough import PassThrough

pytestmark = pytest.mark.usefixtures("all_cores_afterwards")

SIZES = [(96, 96), (8, 8), (33, 70), (97, 5), (5, 97)]
"""Some cut tiles and blocks; some are narrower than what the shader's kernel takes at a time."""

KINDS: list[dict[str, object]] = [{}, {"latents": 0, "hidden": 21}, {"hidden_layers": 1, "depth_gradient": True}]


def upstream(width: int, height: int) -> Tensor:
    drawn = torch.randn(3, height, width, generator=torch.Generator().manual_seed(1))
    return drawn.permute(1, 2, 0)


def step(model: SplatModel, camera: Camera, buffers: tuple[str, ...] = ()) -> tuple[Rendering, dict[str, Tensor]]:
    rendering = model.render(camera, WHITE, Want.GRADIENTS, buffers)
    gradients = rendering.backward(upstream(camera.width, camera.height), {})
    return rendering, {name: dense(gradient) for name, gradient in gradients.items()}


def assert_same(found: dict[str, Tensor], expected: dict[str, Tensor]) -> None:
    assert found.keys() == expected.keys()
    for name, tensor in expected.items():
        assert torch.equal(found[name], tensor), name


@pytest.mark.parametrize("size", SIZES)
@pytest.mark.parametrize("shader", KINDS)
def test_gradients_and_exact_have_the_same_bits_in_tiles_or_not(size: tuple[int, int], shader: dict[str, object]):
    """Tiles are shaded as they are blended, also where somebody looks at buffers that are blended anyway."""
    model, camera = mirror("3000@96", **shader), view(*size)
    expected, gradients = step(model, camera)
    assert {name for name in gradients if name.startswith("shader.")} == {
        name for name, _ in model.named_parameters() if name.startswith("shader.")
    }
    assert (expected.color - expected.buffers["rgb"]).abs().max() > 0
    exact = [model.render(camera, WHITE, Want.EXACT, buffers) for buffers in ((), ("depth",))]
    with patch.object(model.shader, "tiles", return_value=None):
        in_planes, same_gradients = step(model, camera, ("depth", "alpha"))
    assert_same(same_gradients, gradients)
    looked_at, same_gradients = step(model, camera, ("depth", "alpha"))
    assert_same(same_gradients, gradients)
    for found in (in_planes, looked_at, *exact):
        assert torch.equal(found.color, expected.color)
        assert torch.equal(found.alpha, expected.alpha)
        assert_same(found.buffers, expected.buffers)


def plain(model: SplatModel, leaves: dict[str, Tensor], camera: Camera, behind: Tensor) -> tuple[Tensor, Channels]:
    """Colour and buffers by the references of all three parts, in one graph of torch."""
    table = {name.removeprefix("columns."): leaf for name, leaf in leaves.items() if name.startswith("columns.")}
    degree = int(model.color.varying.active_degree)
    channels = varying_channels_reference(table, leaves["color.varying.basis"], camera, degree)
    widths = [values.shape[-1] for values in channels.values()]
    shared = leaves["color.varying.opacity_basis"]
    factor = factors_reference(
        table["means"], table["opacity_logits"], table["basis_weights"], shared, camera.position, degree
    )
    columns = table | {"channels": torch.cat(list(channels.values()), -1), "opacity_factor": factor}
    behind = torch.cat([behind, behind.new_zeros(sum(widths) - 3)])
    image, alpha, _ = blended(columns, camera, behind, model.options)
    buffers = dict(zip(channels, image.split(widths, -1), strict=True)) | {"alpha": alpha}
    return model.shader.reference(buffers, camera, behind[:3]), buffers


@pytest.mark.parametrize("shader", [{}, {"depth_gradient": True}, {"parallax": False, "axis_nodes": 0}])
def test_the_seams_add_up_to_one_graph_of_torch(shader: dict[str, object]):
    """In double precision; the picture, depth and alpha all have a gradient, also where the shader reads no depth."""
    small, camera = mirror("60@24", gradient_share=1.0, **shader), view(24, 20)
    table = Gaussians.from_columns({name: column.detach().double() for name, column in small.columns.items()})
    model = SplatModel(table, small.color.double(), small.shader.double(), ReferenceRasterizer(), small.options)
    behind, by_color = WHITE.double(), upstream(24, 20).double()
    by_buffers = {"depth": by_color[..., :1] ** 2, "alpha": by_color[..., 1:2]}

    leaves = dict(model.named_parameters())
    color, buffers = plain(model, leaves, camera, behind)
    loss = (color * by_color).sum() + sum((buffers[name] * by_buffers[name]).sum() for name in by_buffers)
    expected = dict(zip(leaves, torch.autograd.grad(loss, list(leaves.values())), strict=True))
    rendering = model.render(camera, behind, Want.GRADIENTS, tuple(by_buffers))
    torch.testing.assert_close(rendering.color, color.detach(), rtol=0, atol=1e-12)
    found = rendering.backward(by_color, by_buffers)
    assert found.keys() == expected.keys()
    for name, gradient in expected.items():
        largest = gradient.abs().max().item()
        assert largest > 0, name
        torch.testing.assert_close(dense(found[name]), gradient, rtol=0, atol=1e-9 * largest)


@pytest.mark.parametrize("buffers", [(), ("depth",)])
def test_the_way_back_is_gone_once(buffers: tuple[str, ...]):
    model = mirror("600@96")
    rendering, _ = step(model, view(), buffers)
    with pytest.raises(RuntimeError, match="gone already; render it again"):
        rendering.backward(upstream(96, 96), {})


def test_up_to_the_opacities_it_is_the_same_way():
    """An opacity here is sigmoid(logit + what the view adds): its logarithm moves by 1 - opacity with the logit."""
    model, camera = mirror("3000@96"), view()
    _, whole = step(model, camera)
    found = model.by_opacity(camera, WHITE, upstream(96, 96))
    factor = model.color.emit(model.gaussians, camera, ("rgb",), Want.EXACT).opacity_factor
    rest = 1 - model.gaussians.opacities.detach() * factor.detach()
    expected = whole["columns.opacity_logits"]
    torch.testing.assert_close(found * rest, expected, rtol=1e-3, atol=1e-5 * expected.abs().max().item())
    rendering = model.render(camera, WHITE, Want.GRADIENTS)
    rendering.backward.to_opacities(upstream(96, 96), model.gaussians.opacity_logits)
    with pytest.raises(RuntimeError, match="gone already"):
        rendering.backward(upstream(96, 96), {})


@pytest.mark.parametrize("want", [Want.EXACT, Want.PICTURE])
def test_only_who_asked_for_gradients_finds_a_way_back(want: Want):
    rendering = mirror("600@96").render(view(), WHITE, want)
    with pytest.raises(RuntimeError, match=r"ask for it with Want\.GRADIENTS"):
        rendering.backward(upstream(96, 96), {})


def test_what_is_drawn_in_between_changes_no_gradient():
    model = mirror("3000@96")
    _, expected = step(model, view())
    rendering = model.render(view(), WHITE, Want.GRADIENTS)
    for want in Want:
        model.render(view(40, 30, turn=1.0), WHITE, want)
    found = rendering.backward(upstream(96, 96), {})
    assert_same({name: dense(gradient) for name, gradient in found.items()}, expected)


def test_a_way_back_that_nobody_goes_keeps_no_workspace():
    model = mirror("600@96")
    for _ in range(3):
        model.render(view(), WHITE, Want.GRADIENTS)
    gc.collect()
    assert len(model.rasterize.spare) == 1


def test_no_block_is_closed_before_it_is_full_where_gradients_are_wanted():
    """A picture alone may close them; the step's must not."""
    model = mirror("20k@96")
    with torch.no_grad():
        model.columns["opacity_logits"].fill_(3.0)
    gradients, exact, picture = (model.render(view(), WHITE, want).alpha for want in Want)
    assert torch.equal(gradients, exact)
    assert not torch.equal(picture, exact)


def test_the_same_bits_for_any_number_of_threads():
    model, results = mirror("3000@96"), []
    for threads in (1, 3):
        _kernels.set_threads(threads)
        results.append(step(model, view()))
    (one, gradients), (other, others) = results
    assert torch.equal(one.color, other.color)
    assert_same(others, gradients)


@pytest.mark.parametrize("where", ["beside it", "no Gaussians"])
def test_where_there_is_nothing_the_background_is_seen(where: str):
    model, camera = mirror("600@96"), view(70, 33)
    if where == "beside it":
        with torch.no_grad():
            model.columns["means"] += 1000 * camera.position
    else:
        model.load_columns({name: column[:0] for name, column in model.columns.items()})
    rendering, gradients = step(model, camera)
    assert torch.equal(rendering.color, WHITE.expand_as(rendering.color))
    assert gradients
    assert not any(gradient.count_nonzero() for gradient in gradients.values())


def test_what_was_blended_goes_with_a_shader():
    """And both with planes of the right size: the compiled rasterizer writes where it is told."""
    model, camera = mirror("50@96"), view(40, 30)
    tiles = model.shader.tiles(camera, WHITE, Want.EXACT)
    channels = model.color.emit(model.gaussians, camera, tuple(model.color.emits), Want.EXACT).channels
    behind = torch.cat([WHITE, torch.zeros(channels.shape[1] - 3)])
    job, table = Job(camera, behind, model.options, len(model)), table_of(model.gaussians, channels, None)
    for shader, planes in (
        (None, torch.empty(11, 30, 40)),
        (tiles, torch.empty(11, 30, 39)),
        (tiles, torch.empty(10, 30, 40)),
    ):
        with pytest.raises(ValueError, match="what was blended goes with a shader"):
            job.draw(_kernels.Workspace(), table, shader=shader, blended=planes)


@pytest.mark.parametrize("buffers", [(), ("depth",), ("normal", "depth")])
def test_before_the_shader_is_lit_the_base_color_is_shown(buffers: tuple[str, ...]):
    """By one switch; whoever looks at other buffers still gets them."""
    model = mirror("600@96")
    lit = model.render(view(), WHITE, buffers=("depth", "normal"))
    model.shader.lit.fill_(False)
    rendering, gradients = step(model, view(), buffers)
    assert torch.equal(rendering.color, rendering.buffers["rgb"])
    assert rendering.buffers.keys() == {"rgb", "alpha", *buffers}
    for name in buffers:
        torch.testing.assert_close(rendering.buffers[name], lit.buffers[name], rtol=0, atol=1e-5)
    assert not any(name.startswith("shader.") for name in gradients)
    assert gradients["columns.base"].any()


def test_before_the_shader_is_lit_a_buffers_gradient_arrives():
    model = mirror("600@96")
    model.shader.lit.fill_(False)
    rendering = model.render(view(), WHITE, Want.GRADIENTS, ("depth",))
    grad_color = torch.zeros(96, 96, 3)
    found = rendering.backward(grad_color, {"depth": torch.ones(96, 96, 1)})
    assert dense(found["columns.means"]).any()
    assert not dense(found["columns.base"]).any()


@pytest.mark.parametrize("want", Want)
def test_what_is_not_finite_is_refused_by_name(want: Want):
    model = mirror("600@96")
    with torch.no_grad():
        model.columns["means"][7, 1] = torch.nan
    with pytest.raises(BackendError, match=r"means.*7"):
        model.render(view(), WHITE, want)


def emission_of(widths: dict[str, int], into: list[tuple[Tensor, Tensor | None]]) -> Emission:
    """Five rows that say which channel they are; notes what its way back is given."""
    channels = torch.arange(5.0 * sum(widths.values())).view(5, -1)
    factor = torch.full((5,), 0.5)
    return Emission(widths, channels, factor, lambda channels, factor, _: into.append((channels, factor)))


def test_channels_are_put_in_order_and_their_gradients_back():
    given: list[tuple[Tensor, Tensor | None]] = []
    emission = emission_of({"rgb": 3, "normal": 3, "depth": 1}, given)
    assert ordered(emission, ("rgb", "normal", "depth")) is emission
    found = ordered(emission, ("depth", "rgb"))
    assert found.widths == {"depth": 1, "rgb": 3}
    assert torch.equal(found.channels, emission.channels[:, [6, 0, 1, 2]])
    assert found.opacity_factor is emission.opacity_factor
    gradient = torch.randn(5, 4, generator=torch.Generator().manual_seed(0))
    found.backward(gradient, emission.opacity_factor, Gradients())
    ((by_channels, by_factor),) = given
    nothing = torch.zeros(5, 3)
    assert torch.equal(by_channels, torch.cat([gradient[:, 1:], nothing, gradient[:, :1]], 1))
    assert by_factor is emission.opacity_factor


class Backwards(PassThrough):
    """Reads depth before the colour, and shows their sum."""

    needs = {"depth": 1, "rgb": 3}  # noqa: RUF012

    def shade(
        self, image: Tensor, alpha: Tensor, camera: Camera, background: Tensor, want: Want, shaded=None
    ) -> Shaded:
        def backward(grad_color: Tensor, into: Gradients) -> tuple[Tensor, None]:
            return torch.cat([grad_color.sum(-1, keepdim=True), grad_color], -1), None

        return Shaded(image[..., 1:] + image[..., :1], backward)


@pytest.mark.parametrize("buffers", [(), ("normal",)])
def test_a_shader_may_ask_for_channels_in_any_order(buffers: tuple[str, ...]):
    usual, camera = mirror("600@96"), view()
    model = SplatModel(usual.gaussians, usual.color, Backwards(), usual.rasterize, usual.options)
    rendering = model.render(camera, WHITE, Want.GRADIENTS, buffers)
    assert list(rendering.buffers) == ["depth", "rgb", *buffers, "alpha"]
    assert torch.equal(rendering.color, rendering.buffers["rgb"] + rendering.buffers["depth"])
    seen = usual.render(camera, WHITE, buffers=("depth",)).buffers
    for name in ("rgb", "depth"):
        torch.testing.assert_close(rendering.buffers[name], seen[name], rtol=0, atol=1e-5)
    gradient = upstream(96, 96)
    found = rendering.backward(gradient, {})
    # The same by a shader that reads the colour alone, where whoever looks at depth has its part of the gradient.
    alone = SplatModel(usual.gaussians, usual.color, PassThrough(), usual.rasterize, usual.options)
    other = alone.render(camera, WHITE, Want.GRADIENTS, ("depth",))
    expected = other.backward(gradient, {"depth": gradient.sum(-1, keepdim=True)})
    assert found.keys() == expected.keys()
    for name, tensor in expected.items():
        largest = dense(tensor).abs().max().item()
        torch.testing.assert_close(dense(found[name]), dense(tensor), rtol=0, atol=1e-5 * largest)


class Greedy(PassThrough):
    """Needs what no colour model emits, or not as wide."""

    def __init__(self, **needs: int):
        super().__init__()
        self.needs = needs


@pytest.mark.parametrize("needs", [{"rgb": 3, "roughness": 1}, {"rgb": 3, "depth": 2}])
def test_parts_that_do_not_agree_on_channels_are_refused_when_the_model_is_built(needs: dict[str, int]):
    usual = mirror("50@96")
    name, width = list(needs.items())[-1]
    sentence = f"needs channel '{name}' of width {width}, and the colour model emits rgb 3, normal 3, .*; put together"
    with pytest.raises(RecipeError, match=sentence):
        SplatModel(usual.gaussians, usual.color, Greedy(**needs), usual.rasterize, RasterOptions())


@pytest.mark.parametrize("name", ["columns.means", "shader.mlp.0.weight"])
def test_parameters_that_were_changed_since_are_refused(name: str):
    model, camera = mirror("40@96"), view()
    rendering = model.render(camera, WHITE, Want.GRADIENTS)
    with torch.no_grad():
        model.get_parameter(name).add_(0.05)
    with pytest.raises(RuntimeError, match="render it again"):
        rendering.backward(upstream(camera.width, camera.height), {})
