"""The standard workload: the same everywhere, in the stated ranges, in view of its camera."""

import pytest
import torch

from ringlight.bench.workload import OPACITIES, Size, workload, workload_scene
from ringlight.errors import RecipeError
from ringlight.fit.strategies.morton import morton_order

SMALL = Size(3000, 40)


def test_it_is_a_function_of_size_and_seed():
    first, second, other = workload(SMALL), workload(SMALL), workload(SMALL, seed=1)
    assert torch.equal(first.gaussians.means, second.gaussians.means)
    assert torch.equal(first.channels, second.channels)
    assert not torch.equal(first.gaussians.means, other.gaussians.means)


def test_ranges_are_the_stated_ones():
    work = workload(SMALL)
    radii = work.gaussians.means.norm(dim=1)
    assert radii.max() <= 1
    # Uniform in the ball: half of the volume lies within 0.794 of the radius.
    assert (radii < 0.5 ** (1 / 3)).float().mean().item() == pytest.approx(0.5, abs=0.05)
    assert work.gaussians.scales.median().item() == pytest.approx(0.012, rel=0.05)
    assert work.gaussians.log_scales.std().item() == pytest.approx(0.5, rel=0.05)
    assert OPACITIES[0] <= work.gaussians.opacities.min()
    assert work.gaussians.opacities.max() <= OPACITIES[1]


def test_rows_are_in_morton_order():
    means = workload(SMALL).gaussians.means
    assert torch.equal(morton_order(means), torch.arange(len(means)))


def test_all_of_it_is_in_view():
    work = workload(SMALL)
    depths = work.camera.depths(work.gaussians.means)
    assert depths.min() >= 3 - 1e-5
    assert depths.max() <= 5 + 1e-5
    assert work.camera.position.norm().item() == pytest.approx(4, rel=1e-6)


def test_scene_shows_the_camera_of_the_workload():
    work = workload(SMALL)
    scene = workload_scene(work)
    assert scene.train[0].image(scene.background_color).shape == (3, 40, 40)
    assert len(scene.points.positions) == len(work.gaussians)


@pytest.mark.parametrize(("text", "size"), [("100k@400", Size(100_000, 400)), ("512@64", Size(512, 64))])
def test_sizes_are_read_as_they_are_written(text, size):
    assert Size.parse(text) == size
    assert size.name == text


@pytest.mark.parametrize("text", ["", "10x", "k@4", "10k@", "0@10", "9999999k@10", "10k@99999", "1e3@5", "-1@5"])
def test_other_sizes_are_refused(text):
    with pytest.raises(RecipeError):
        Size.parse(text)
