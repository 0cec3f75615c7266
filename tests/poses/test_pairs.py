"""Pairs of photographs: all of few; of many, neighbours by name and those that look alike."""

import numpy as np

from ringlight.poses.pairs import all_pairs, neighbour_pairs, vlad


def views_of(subjects: int, each: int) -> list[np.ndarray]:
    """Descriptors of photographs that go through the subjects in turn: what a subject shows differs little."""
    rng = np.random.default_rng(0)
    looks = rng.integers(0, 256, (subjects, 60, 128))
    found = [looks[index % subjects] + rng.integers(-8, 9, (60, 128)) for index in range(subjects * each)]
    return [np.clip(one, 0, 255).astype(np.uint8) for one in found]


def test_all_pairs_are_each_pair_once():
    pairs = all_pairs(["b", "a", "c"])
    assert sorted(pairs) == [("a", "b"), ("a", "c"), ("b", "c")]


def test_photographs_of_the_same_subject_look_alike():
    looks = vlad(views_of(5, 6), seed=0)
    likeness = looks @ looks.T
    np.fill_diagonal(likeness, -1)
    assert (likeness.argmax(1) % 5 == np.arange(30) % 5).all()
    np.testing.assert_array_equal(looks, vlad(views_of(5, 6), seed=0))


def test_a_loop_is_closed_by_looks_and_neighbours_are_always_compared():
    """The camera comes back after 150 photographs, which no name tells."""
    views = views_of(150, 2)
    names = [f"f{index:04d}.jpg" for index in range(300)]
    of = dict(zip(names, views, strict=True))
    pairs = set(neighbour_pairs(names, of.__getitem__, seed=0))
    assert all((names[i], names[i + 150]) in pairs for i in range(150))
    assert all((names[i], names[i + d]) in pairs for i in range(280) for d in (1, 2, 10, 16))
    assert all(one < other for one, other in pairs)
    assert len(pairs) < 300 * 299 / 2 / 4


def test_photographs_without_features_have_neighbours_all_the_same():
    nothing = np.zeros((0, 128), np.uint8)
    pairs = neighbour_pairs(["a", "b", "c"], lambda name: nothing, seed=0)
    assert set(pairs) == {("a", "b"), ("b", "c"), ("a", "c")}
