"""Batches are a pure function of (seed, step): every view once an epoch."""

from dataclasses import replace

import torch

from ringlight.data.batches import ImageBatches
from tiny_scene import tiny_scene


def test_every_view_once_an_epoch_in_an_order_that_changes():
    scene = tiny_scene(views=9)
    count = len(scene.train)
    batches = ImageBatches(scene, seed=5)
    epochs = [[batches.at(1 + epoch * count + i).index for i in range(count)] for epoch in range(3)]
    assert all(sorted(epoch) == list(range(count)) for epoch in epochs)
    assert len({tuple(epoch) for epoch in epochs}) > 1


def test_a_step_is_the_same_whatever_was_asked_before():
    scene = tiny_scene()
    batches = ImageBatches(scene, seed=5)
    forwards = [batches.at(step).index for step in range(1, 30)]
    assert [ImageBatches(scene, seed=5).at(step).index for step in range(29, 0, -1)] == forwards[::-1]


def test_a_random_background_belongs_to_its_step():
    scene = replace(tiny_scene(), background="random")
    first, second = (ImageBatches(scene, seed=5) for _ in range(2))
    assert torch.equal(first.at(7).background, second.at(7).background)
    assert not torch.equal(first.at(7).background, first.at(8).background)


def test_a_named_background_is_used():
    scene = replace(tiny_scene(), background="black")
    assert ImageBatches(scene, seed=0).at(1).background.tolist() == [0.0, 0.0, 0.0]
