"""A training step that asks for no buffers keeps what was blended tile by tile; its gradients are those of planes."""

from dataclasses import replace

import numpy as np
import pytest
import torch
from mirrors import WHITE, mirror, view
from torch import Tensor

from ringlight import _kernels
from ringlight.core.camera import Camera
from ringlight.core.gradients import Gradients
from ringlight.core.importance_sampling import importance_weights
from ringlight.core.kernel_limits import BLOCK, TILE
from ringlight.core.rendering import KeptTiles, Raster, Rendering
from ringlight.core.scene import View
from ringlight.core.want import Want
from ringlight.data.batches import ImageBatch
from ringlight.models.splats import SplatModel
from ringlight.shade.covered import FAINTEST_SHADED
from ringlight.shade.tile_order import tiles_from_planes

pytestmark = pytest.mark.usefixtures("all_cores_afterwards")

KINDS: dict[str, dict[str, object]] = {
    "default": {},
    "depth": {"depth_gradient": True},
    "no depth": {"parallax": False, "axis_nodes": 0},
    "no latents": {"latents": 0},
    "many latents": {"latents": 9},
    "one hidden layer": {"hidden_layers": 1},
}


def predicted(model: SplatModel, camera: Camera, buffers: tuple[str, ...] = ()) -> Rendering:
    batch = ImageBatch(0, View("seen", camera, lambda: np.zeros((camera.height, camera.width, 3), np.uint8)), WHITE)
    return model.predict(batch, Want.GRADIENTS, buffers)


def upstream(camera: Camera) -> Tensor:
    return torch.randn(camera.height, camera.width, 3, generator=torch.Generator().manual_seed(7))


def steps(model: SplatModel, camera: Camera) -> tuple[Rendering, Gradients, Rendering, Gradients]:
    """Rendering and gradients by tiles, then by planes."""
    by_tile, by_plane = predicted(model, camera), predicted(model, camera, ("normal",))
    assert not by_tile.buffers
    assert "normal" in by_plane.buffers
    given = upstream(camera)
    return by_tile, by_tile.backward(given, {}), by_plane, by_plane.backward(given, {})


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("size", [(96, 96), (70, 33), (5, 97)])
def test_gradients_are_those_of_planes(kind: str, size: tuple[int, int]):
    by_tile, found, by_plane, expected = steps(mirror(gradient_share=1.0, **KINDS[kind]), view(*size))
    assert torch.equal(by_tile.color, by_plane.color)
    assert torch.equal(by_tile.alpha, by_plane.alpha)
    assert found.keys() == expected.keys()
    for name, gradient in expected.items():
        if not gradient.numel():  # of latents that there are none of
            continue
        assert gradient.count_nonzero(), name
        assert torch.equal(found[name], gradient), name


def in_tile_order(planes: Tensor) -> Tensor:
    """[H W c] to [Q c], those beyond the image 0."""
    return tiles_from_planes(planes.permute(2, 0, 1)).transpose(1, 2).flatten(0, 1)


@pytest.mark.parametrize("share", [0.1, 0.4, 1.0])
def test_lots_are_laid_end_to_end_tile_by_tile(share: float):
    model, camera = mirror(gradient_share=share), view(70, 41)
    given, drawn = upstream(camera), []
    tiles = model.shader.tiles(camera, WHITE, Want.GRADIENTS)
    assert tiles is not None
    back = tiles.backward
    assert back is not None

    def noted(kept: KeptTiles, grad_color: Tensor, into: Gradients) -> tuple[Tensor, Tensor]:
        found = back(kept, grad_color, into)
        drawn.append(found[1])
        return found

    shading = replace(tiles, backward=noted)
    model.shader.tiles = lambda *_: shading  # type: ignore[method-assign]
    rendering = predicted(model, camera)
    rendering.backward(given, {})
    is_covered = in_tile_order(rendering.alpha)[:, 0] > FAINTEST_SHADED
    sizes = torch.where(is_covered[:, None], in_tile_order(given), 0)
    expected = importance_weights(sizes, share) != 0 if share < 1 else is_covered
    bits = torch.arange(BLOCK**2)
    found = (drawn[0][:, None] >> bits & 1).flatten().bool()
    assert expected.any()
    assert torch.equal(found, expected)


def test_the_same_bits_for_any_number_of_threads():
    model, results = mirror("3000@96"), []
    for threads in (1, 2, 3):
        _kernels.set_threads(threads)
        results.append(predicted(model, view(90, 96)).backward(upstream(view(90, 96)), {}))
    for other in results[1:]:
        assert all(torch.equal(other[name], gradient) for name, gradient in results[0].items())


def test_where_there_is_nothing_nothing_has_a_gradient():
    model, camera = mirror(), view(70, 33)
    with torch.no_grad():
        model.columns["means"] += 1000 * camera.position
    gradients = predicted(model, camera).backward(upstream(camera), {})
    assert gradients
    assert not any(gradient.count_nonzero() for gradient in gradients.values())


def test_buffers_that_were_not_asked_for_get_no_gradient():
    rendering = predicted(mirror(), view())
    with pytest.raises(RuntimeError, match="'depth' has a gradient; ask for it"):
        rendering.backward(upstream(view()), {"depth": torch.zeros(96, 96, 1)})


def test_what_does_not_fit_is_refused():
    """The compiled kernels read and write where they are told."""
    model, camera = mirror("50@96"), view(40, 30)
    tiles = model.shader.tiles(camera, WHITE, Want.GRADIENTS)
    assert tiles is not None
    assert tiles.backward is not None
    blocks = camera.native.tile_pixels // BLOCK**2
    for shape in ((blocks, 11, BLOCK**2), (blocks - (TILE // BLOCK) ** 2, 12, BLOCK**2)):
        kept = KeptTiles(torch.zeros(shape), torch.zeros(12 * camera.native.tile_pixels))
        with pytest.raises(ValueError, match="tiles are of another shape"):
            tiles.backward(kept, upstream(camera), Gradients())
    rasters: list[Raster] = []
    draw = model.rasterize.draw
    model.rasterize.draw = lambda *job: rasters.append(draw(*job)) or rasters[0]  # type: ignore
    predicted(model, camera)
    assert rasters[0].tiles is not None
    values = rasters[0].tiles.values
    drawn = torch.zeros(len(values), dtype=torch.int32)
    for found, bits in ((values[:, :4].contiguous(), drawn), (values[1:], drawn[1:])):
        with pytest.raises(ValueError, match="of other shapes than those of the last forward pass"):
            rasters[0].backward(found, bits, Gradients())


def test_two_views_that_are_drawn_before_either_goes_back_have_tiles_of_their_own():
    model, cameras = mirror(), (view(70, 33), view(96, 90))
    alone = [predicted(model, camera).backward(upstream(camera), {}) for camera in cameras]
    together = [predicted(model, camera) for camera in cameras]
    for camera, expected, rendering in zip(cameras, alone, together, strict=True):
        found = rendering.backward(upstream(camera), {})
        assert all(torch.equal(found[name], gradient) for name, gradient in expected.items())


def test_what_a_larger_view_left_in_its_memory_reaches_no_gradient():
    model, small, large = mirror(), view(40, 30), view(96, 96)
    expected = predicted(model, small).backward(upstream(small), {})
    predicted(model, large).backward(torch.full((96, 96, 3), float("nan")), {})
    found = predicted(model, small).backward(upstream(small), {})
    assert all(torch.equal(found[name], gradient) for name, gradient in expected.items())
