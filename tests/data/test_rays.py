"""Lots of rays are rays of the photographs' pixels, and a function of the step and of what is kept alone."""

import dataclasses

import pytest
import torch

from ringlight.data import rays
from ringlight.data.ray_errors import UNSEEN
from ringlight.data.rays import RayBatches, rays_of
from tiny_scene import tiny_scene

SCENE = tiny_scene(views=5, size=12)
COUNT = 400


def test_rays_and_colours_are_those_of_the_photographs_pixels():
    batch = RayBatches(SCENE, COUNT, 7).at(3)
    known = {}
    for view in SCENE.train:
        colors = view.image(SCENE.background_color).permute(1, 2, 0).reshape(-1, 3)
        rays = rays_of(view.camera)
        for direction, origin, color in zip(rays.directions, rays.origins, colors, strict=True):
            known[tuple((direction + origin).mul(1e4).round().int().tolist())] = (direction, origin, color)
    for direction, origin, color in zip(batch.rays.directions, batch.rays.origins, batch.colors, strict=True):
        near = tuple((direction + origin).mul(1e4).round().int().tolist())
        found = next(k for d in range(-1, 2) for k in [known.get((near[0] + d, near[1], near[2]))] if k is not None)
        torch.testing.assert_close(direction, found[0], rtol=0, atol=1e-5)
        torch.testing.assert_close(origin, found[1], rtol=0, atol=1e-5)
        torch.testing.assert_close(color, found[2], rtol=0, atol=1e-6)


def test_a_step_draws_the_same_whatever_was_drawn_before():
    one, other = RayBatches(SCENE, COUNT, 7), RayBatches(SCENE, COUNT, 7)
    for step in (1, 2):
        one.at(step)
    a, b = one.at(9), other.at(9)
    assert torch.equal(a.rays.directions, b.rays.directions)
    assert torch.equal(a.rays.jitter, b.rays.jitter)
    assert not torch.equal(a.rays.jitter, one.at(10).rays.jitter)
    assert not torch.equal(a.rays.jitter, RayBatches(SCENE, COUNT, 8).at(9).rays.jitter)


def test_backgrounds_may_vary_at_first():
    scene = dataclasses.replace(SCENE, background="black")
    batches = RayBatches(scene, COUNT, 0, varied=3)
    assert batches.at(3).background.any()
    assert not batches.at(4).background.any()
    opaque = tuple(dataclasses.replace(view, has_alpha=False) for view in scene.train)
    assert not RayBatches(dataclasses.replace(scene, train=opaque), COUNT, 0, varied=3).at(3).background.any()


@pytest.mark.parametrize("masked", [True, False])
def test_rays_of_the_subject_are_those_of_its_masks_or_of_other_colours_than_the_background(masked: bool):
    views = []
    for view in SCENE.train:
        pixels = view.load()
        if not masked:
            pixels = (view.image(SCENE.background_color).permute(1, 2, 0) * 255).round().byte().numpy()
        views.append(dataclasses.replace(view, has_alpha=masked, load=lambda pixels=pixels: pixels))
    found = RayBatches(dataclasses.replace(SCENE, train=tuple(views)), COUNT, 0).shows_subject()
    alpha = torch.cat([torch.from_numpy(view.load())[..., 3].flatten() for view in SCENE.train])
    assert not found[alpha == 0].any()
    share = found[alpha == 255].float().mean()
    assert share == 1 if masked else share > 0.8


def test_only_kept_rays_are_drawn():
    batches = RayBatches(SCENE, COUNT, 0)
    upwards = batches.looked_at(lambda rays: rays.directions[:, 2] > 0)
    assert 0 < upwards.sum() < batches.all_rays
    batches.keep(upwards)
    assert batches.kept_rays == int(upwards.sum())
    assert (batches.at(1).rays.directions[:, 2] > 0).all()


def test_kept_rays_are_looked_for_piece_by_piece(monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setattr(rays, "LOOKED_AT_ONCE", 7)
    batches = RayBatches(SCENE, COUNT, 0)
    upwards = batches.looked_at(lambda rays: rays.directions[:, 2] > 0)
    batches.keep(upwards)
    assert torch.equal(batches._kept, upwards.nonzero()[:, 0].int())
    assert batches.bytes_kept + upwards.numel() <= RayBatches.bytes_of(batches.all_rays)
    batches.keep(~upwards)
    assert torch.equal(batches._kept, (~upwards).nonzero()[:, 0].int())


@pytest.mark.parametrize("background", ["black", "white", "random"])
def test_what_is_not_opaque_lies_over_the_background(background: str):
    batch = RayBatches(dataclasses.replace(SCENE, background=background), COUNT, 0).at(4)
    most = batch.colors[(batch.colors == batch.background).all(-1)]
    assert len(most) > COUNT / 4


def test_what_was_shown_decides_what_is_drawn_next_and_the_same_for_the_same():
    one, other, never = (RayBatches(SCENE, COUNT, 0, by_error=0.8) for _ in range(3))
    for batches in (one, other):
        colors = batches.at(1).colors
        batches.learn(1, torch.where(torch.arange(COUNT)[:, None] % 2 == 0, colors, 1 - colors))
        batches.learn(1, torch.rand(COUNT, 3))  # it was forgotten
        batches.at(7)
        batches.learn(6, torch.rand(COUNT, 3))  # of another lot
    assert torch.equal(one.at(2).rays.directions, other.at(2).rays.directions)
    assert torch.equal(one.errors.errors, other.errors.errors)
    assert not torch.equal(one.at(2).rays.directions, never.at(2).rays.directions)
    assert (one.errors.errors < never.errors.errors).any()


def test_rays_that_are_drawn_by_error_are_kept_ones():
    batches = RayBatches(SCENE, COUNT, 0, by_error=0.5)
    upwards = batches.looked_at(lambda rays: rays.directions[:, 2] > 0)
    batches.keep(upwards)
    assert batches.kept_rays == int(upwards.sum())
    batch = batches.at(1)
    assert (batch.rays.directions[:, 2] > 0).all()
    assert batch.weights.shape == (COUNT,)
    assert batches.bytes_kept > batches.all_rays * rays.CHANNELS


def test_errors_are_those_of_the_photographs_that_were_wrong():
    batches = RayBatches(SCENE, COUNT, 0, by_error=0.5)
    batch = batches.at(1)
    wrong = SCENE.train[1].camera.position
    of_it = (batch.rays.origins - wrong).norm(dim=-1) < 1e-6
    assert 0 < of_it.sum() < COUNT
    batches.learn(1, torch.where(of_it[:, None], batch.colors + 0.5, batch.colors))
    errors = batches.errors.errors.view(len(SCENE.train), -1)
    assert errors[1][errors[1] < UNSEEN].sub(0.25).abs().max() < 1e-6
    others = errors[[0, *range(2, len(SCENE.train))]]
    assert not others[others < UNSEEN].any()


def test_tables_of_blocks_fit_into_what_is_planned_for():
    batches = RayBatches(SCENE, COUNT, 0, by_error=0.5)
    batches.at(1)
    errors = batches.errors.errors
    assert batches.bytes_kept + errors.numel() * errors.element_size() <= RayBatches.bytes_of(batches.all_rays)
