"""Blended normals against those of blended depths, on a tilted plane whose normal is known."""

import pytest
import torch

from ringlight.core.camera import Camera
from ringlight.core.directions import normalize
from ringlight.core.rendering import Rendering
from ringlight.fit.regularizers.depth_normals import DepthNormals
from ringlight.models.contract import Model
from ringlight.rasterize.choose import rasterizer_for
from small_recipes import small
from tiny_scene import tiny_scene

WIDTH, HEIGHT, ALPHA = 40, 30, 0.95
NORMAL = normalize(torch.tensor([0.2, -0.3, -1.0]))
CAMERA = Camera(torch.eye(4), (100.0, 110.0), (20.0, 15.0), WIDTH, HEIGHT)


def plane(normal: torch.Tensor, alpha: float = ALPHA) -> Rendering:
    """Seen by the camera at the origin, with this as its blended normal."""
    rays = CAMERA.ray_directions()
    depth = -3 / (rays @ NORMAL) * rays[..., 2]
    buffers = {
        "normal": normal.expand(HEIGHT, WIDTH, 3) * alpha,
        "depth": depth[..., None] * alpha,
        "alpha": torch.full((HEIGHT, WIDTH, 1), alpha),
    }
    return Rendering(torch.zeros(HEIGHT, WIDTH, 3), buffers["alpha"], buffers, camera=CAMERA)


@pytest.fixture(scope="module")
def model() -> Model:
    built: Model = small("3dgs", steps=2).build(tiny_scene(views=2, size=8), rasterizer_for("auto"), 0).model
    return built


@pytest.mark.parametrize("stride", [1, 3])
@pytest.mark.parametrize(("normal", "expected"), [(NORMAL, 0.0), (-NORMAL, 2.0)])
def test_the_plane_has_the_normal_of_its_depths(model: Model, stride: int, normal: torch.Tensor, expected: float):
    assert DepthNormals(1.0, stride).term(5, model, plane(normal)).value.item() == pytest.approx(expected, abs=1e-5)


def test_all_pixels_have_their_turn(model: Model):
    wrong = normalize(NORMAL + torch.tensor([0.3, 0.0, 0.0]))
    seen = torch.zeros(HEIGHT, WIDTH, dtype=torch.int64)
    for step in range(1, 10):
        seen += DepthNormals(1.0, 3).term(step, model, plane(wrong)).grad_buffers["normal"].any(-1)
    assert torch.equal(seen[1:-1, 1:-1], torch.ones(HEIGHT - 2, WIDTH - 2, dtype=torch.int64))
    assert not seen[0].any()


def test_what_is_not_covered_has_no_say(model: Model):
    term = DepthNormals(1.0).term(1, model, plane(-NORMAL, alpha=0.5))
    assert term.value.item() == 0
    assert not term.grad_buffers


def test_every_few_steps_it_counts_as_often_and_looks_at_other_pixels_each_time(model: Model):
    wrong = normalize(NORMAL + torch.tensor([0.3, 0.0, 0.0]))
    few, always = DepthNormals(1.0, 2, range(0, 99, 3)), DepthNormals(1.0, 2)
    assert [step for step in range(1, 10) if few.looks(step)] == [3, 6, 9]
    assert [step for step in range(1, 12) if DepthNormals(1.0, steps=range(6, 11, 3)).looks(step)] == [6, 9]
    assert all(always.looks(step) for step in range(1, 10))
    for look in range(1, 5):
        seldom, often = few.term(3 * look, model, plane(wrong)), always.term(look, model, plane(wrong))
        torch.testing.assert_close(seldom.value, 3 * often.value)
        for name, gradient in often.grad_buffers.items():
            torch.testing.assert_close(seldom.grad_buffers[name], 3 * gradient)


def test_pixels_whose_normals_differ_much_are_left_out(model: Model):
    wrong = normalize(NORMAL + torch.tensor([0.3, 0.0, 0.0]))
    cosine = float(wrong @ NORMAL)
    for least, heard in ((cosine - 0.01, True), (cosine + 0.01, False)):
        term = DepthNormals(1.0, least_cosine=least).term(1, model, plane(wrong))
        assert term.value.item() == pytest.approx((1 - cosine) if heard else 0.0, abs=1e-4)
        assert all(bool(gradient.any()) is heard for gradient in term.grad_buffers.values())
