"""Views by how near they lie to the training cameras."""

import math
from statistics import fmean

import pytest
import torch
from hypothesis import given
from hypothesis import strategies as st

from ringlight.core.camera import Camera
from ringlight.measure.nearness import distances, means_of_thirds


def camera_at(*position: float) -> Camera:
    matrix = torch.eye(4)
    matrix[:3, 3] = -torch.tensor(position)
    return Camera(matrix, (20.0, 20.0), (10.0, 10.0), 20, 20)


def test_the_distance_is_to_the_nearest_training_camera():
    training = [camera_at(0, 0, 0), camera_at(10, 0, 0)]
    found = distances([camera_at(1, 0, 0), camera_at(7, 4, 0), camera_at(10, 0, 0)], training)
    assert found == pytest.approx([1, 5, 0])


def test_without_training_cameras_all_are_far():
    assert distances([camera_at(1, 0, 0)], []) == [math.inf]
    assert distances([], [camera_at(1, 0, 0)]) == []


def test_the_same_place_is_exactly_zero_among_many():
    places = torch.rand(60, 3, generator=torch.Generator().manual_seed(0)).tolist()
    assert distances([camera_at(*place) for place in places], [camera_at(*place) for place in places]) == [0.0] * 60


def test_thirds_go_from_the_nearest_to_the_farthest():
    assert means_of_thirds([30.0, 10.0, 20.0, 40.0], [3.0, 1.0, 2.0, 4.0]) == (10.0, 20.0, 35.0)


def test_of_equal_distances_the_first_comes_first():
    assert means_of_thirds([1.0, 2.0, 3.0], [0.0, 0.0, 0.0]) == (1.0, 2.0, 3.0)


@pytest.mark.parametrize("count", [1, 2])
def test_fewer_than_three_views_have_no_thirds(count: int):
    assert means_of_thirds([20.0] * count, [1.0] * count) is None


@given(st.lists(st.tuples(st.floats(0, 60), st.floats(0, 9)), min_size=3, max_size=40))
def test_thirds_hold_every_view_once(views: list[tuple[float, float]]):
    values, apart = [value for value, _ in views], [distance for _, distance in views]
    thirds = means_of_thirds(values, apart)
    assert thirds is not None
    sizes = [len(views) * (third + 1) // 3 - len(views) * third // 3 for third in range(3)]
    assert max(sizes) - min(sizes) <= 1
    whole = math.fsum(size * mean for size, mean in zip(sizes, thirds, strict=True)) / len(views)
    assert whole == pytest.approx(fmean(values), abs=1e-9)
