"""Pictures that are shaded while they are blended are those that training sees."""

from unittest.mock import patch

import pytest
import torch
from mirrors import WHITE, mirror, view
from torch import Tensor

from ringlight import _kernels
from ringlight.core.camera import Camera
from ringlight.core.rendering import Rendering
from ringlight.core.want import Want
from ringlight.errors import BackendError
from ringlight.models.splats import SplatModel
from ringlight.rasterize.convention import EARLY_STOP

pytestmark = pytest.mark.usefixtures("all_cores_afterwards")

IN_BYTES = _kernels.isa() in ("avx512", "avx512_bf16")
"""Whether the layer between two hidden ones multiplies bytes here: all else has the same bits."""
ROUNDING_OF_BYTES = 0.02
"""Of the largest residual; a trained one is a third of the range of colours at most."""


def opaque(model: SplatModel, opacity: float) -> None:
    """All rows equally so, with normals of which neighbours agree, as on a surface."""
    with torch.no_grad():
        model.columns["opacity_logits"].fill_(torch.tensor(opacity).logit().item())
        model.columns["normals"].copy_(model.columns["means"])


def picture(model: SplatModel, camera: Camera, behind: Tensor = WHITE) -> Rendering:
    return model.render(camera, behind, Want.PICTURE)


def in_planes(model: SplatModel, camera: Camera) -> Rendering:
    """All is blended first and shaded afterwards."""
    with patch.object(model.shader, "tiles", return_value=None):
        return model.render(camera, WHITE, Want.EXACT)


def both(model: SplatModel, camera: Camera) -> tuple[Tensor, Tensor, Tensor]:
    """The picture shaded in tiles, that shaded in planes, and what the latter added to the base colours."""
    tiles, planes = picture(model, camera), in_planes(model, camera)
    assert torch.equal(tiles.alpha, planes.alpha)  # no tile is full enough to be done early
    assert not tiles.buffers
    return tiles.color, planes.color, planes.color - planes.buffers["rgb"]


OTHERS: tuple[dict[str, object], ...] = (
    {"parallax": False},
    {"axis_nodes": 0},
    {"shells": 2},
    {"latents": 0},
    {"latents": 9},
    {"hidden": 21},
    {"raw_direction": True},
    {"parallax": False, "axis_nodes": 0},  # which reads no depth
)


@pytest.mark.parametrize("shader", [{}, *OTHERS])
def test_tiles_are_shaded_as_planes_are(shader: dict[str, object]):
    tiles, planes, residual = both(mirror(**shader), view())
    assert residual.std() > 0.015  # steps of 8 bits are 0.004
    if IN_BYTES:
        assert not torch.equal(tiles, planes)
        assert (tiles - planes).abs().max() < ROUNDING_OF_BYTES * residual.abs().max()
    else:
        assert torch.equal(tiles, planes)


@pytest.mark.parametrize("size", [(96, 96), (8, 8), (33, 70), (97, 5)])
def test_without_a_second_hidden_layer_they_have_the_same_bits(size: tuple[int, int]):
    tiles, planes, residual = both(mirror(hidden_layers=1), view(*size))
    assert residual.abs().max() > 0
    assert torch.equal(tiles, planes)


@pytest.mark.parametrize("hidden", [32, 64])
@pytest.mark.parametrize("turn", [0.0, 1.0, 2.0])
def test_what_is_nearly_opaque_is_shaded_as_it_is(turn: float, hidden: int):
    model = mirror("20k@96", hidden=hidden)
    opaque(model, 0.6)
    with torch.no_grad():
        tiles, planes = picture(model, view(turn=turn)), in_planes(model, view(turn=turn))
    filled = tiles.alpha - planes.alpha
    assert 0 <= filled.min() <= filled.max() < EARLY_STOP
    assert filled.max() > 0
    # Root mean square: maps of noise show a normal's last part many times over in single pixels.
    assert (tiles.color - planes.color).square().mean().sqrt() < 1.3 * EARLY_STOP


def test_what_fills_up_a_block_has_all_channels_in_front():
    """Of a surface that is the same everywhere: what is shaded must not depend on how much of it was blended."""
    model, camera = mirror("20k@96", parallax=False), view()
    opaque(model, 0.6)
    with torch.no_grad():
        model.get_parameter("shader.places.axes").fill_(1)
        model.columns["base"].fill_(0.3)
        model.columns["latents"].fill_(0.2)
        model.columns["basis_weights"].zero_()
        model.columns["normals"].copy_(torch.tensor([0.1, 0.2, -1.0]))
        tiles, planes = picture(model, camera), in_planes(model, camera)
        black = picture(model, camera, torch.zeros(3))
    filled = ((tiles.alpha == 1) & (planes.alpha > 1 - EARLY_STOP)).expand(-1, -1, 3)
    assert filled.any()
    assert torch.equal(tiles.color[filled], black.color[filled])  # nothing of what lies behind
    assert (tiles.color - planes.color)[filled].abs().max() < 2 * EARLY_STOP  # bytes round besides


def test_faint_pixels_keep_their_base_color():
    model = mirror("40@96")
    with torch.no_grad():
        model.columns["opacity_logits"].fill_(torch.tensor(0.015).logit().item())
        tiles, planes, residual = both(model, view())
    assert not residual.any()
    assert torch.equal(tiles, planes)
    assert (planes < 1).any()


def test_the_same_bits_for_any_number_of_threads():
    model = mirror("20k@96", hidden=20)
    _kernels.set_threads(1)
    usual = picture(model, view()).color
    _kernels.set_threads(3)
    assert torch.equal(picture(model, view()).color, usual)


def test_before_the_surface_is_lit_the_picture_is_the_base_color():
    model = mirror()
    model.shader.lit.fill_(False)
    assert torch.equal(picture(model, view()).color, in_planes(model, view()).color)


def test_what_is_not_finite_is_named():
    model = mirror("50@96")
    with torch.no_grad():
        model.columns["means"][7, 1] = torch.nan
    with pytest.raises(BackendError, match="means"):
        picture(model, view())


@pytest.mark.parametrize("layer", ["mlp.0", "mlp.2", "mlp.4"])
@pytest.mark.parametrize("value", [torch.nan, torch.inf])
def test_a_broken_network_shows_in_the_picture(layer: str, value: float):
    """Bytes cannot hold what is not finite: a picture that looks right would be a lie."""
    model = mirror("50@96")
    with torch.no_grad():
        model.get_parameter(f"shader.{layer}.weight").fill_(value)
    assert picture(model, view()).color.isnan().any()


def test_a_mirror_in_double_precision_is_refused_in_a_sentence():
    with pytest.raises(BackendError, match="draws float32"):
        picture(mirror("50@96").double(), view())


def test_a_shaded_picture_has_no_way_back():
    """Nor does the rasterizer keep anything of it."""
    model = mirror("50@96")
    with pytest.raises(RuntimeError, match=r"Want\.GRADIENTS"):
        picture(model, view()).backward(torch.ones(96, 96, 3), {})
    with pytest.raises(ValueError, match="no forward pass"):
        model.rasterize.spare[-1].workspace.count_pairs()
