"""Numbers depend on seed, step and purpose, and on nothing else."""

import torch

from ringlight.core.randomness import generator


def draw(*key) -> list[float]:
    return torch.rand(4, generator=generator(*key)).tolist()


def test_the_same_key_gives_the_same_numbers_whatever_ran_before():
    first = draw(1, 2, "split")
    torch.rand(100)
    draw(3, 4, "order of views")
    assert draw(1, 2, "split") == first


def test_seed_step_and_purpose_each_matter():
    keys = [(1, 2, "split"), (2, 2, "split"), (1, 3, "split"), (1, 2, "background"), (12, 2, "split"), (1, 22, "split")]
    drawn = [tuple(draw(*key)) for key in keys]
    assert len(set(drawn)) == len(keys)
