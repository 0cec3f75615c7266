"""Wrong shapes are refused in calls and in dataclasses of the package; what has no arrays is left as it is."""

import os
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
import pytest
import torch
from jaxtyping import Float

from checked_shapes import checked
from ringlight.core.camera import Camera
from ringlight.core.directions import view_directions


def total(a: Float[np.ndarray, "N 3"], b: Float[np.ndarray, "N"] | None = None) -> Float[np.ndarray, "3"]:
    return a.sum(0) if b is None else b @ a


def halves(a: Float[np.ndarray, "N"], b: Float[np.ndarray, "N"] | None = None) -> Iterator[Float[np.ndarray, "M"]]:
    yield from np.split(a, 2)


@dataclass(frozen=True)
class Pair:
    first: Float[np.ndarray, "N"]
    second: Float[np.ndarray, "N"]


def test_right_shapes_pass():
    assert checked(total)(np.ones((4, 3)), b=np.ones(4)).tolist() == [4.0] * 3
    assert checked(total)(np.ones((4, 3))).tolist() == [4.0] * 3
    assert [half.size for half in checked(halves)(np.ones(6))] == [3, 3]
    assert checked(Pair)(np.ones(2), np.ones(2)).second.size == 2


@pytest.mark.parametrize(
    "arguments",
    [(np.ones((4, 2)),), (np.ones(3),), ([[1.0, 2.0, 3.0]],), (np.ones((4, 3), int),), (np.ones((4, 3)), np.ones(5))],
)
def test_an_argument_of_another_shape_or_type_is_refused(arguments: tuple[object, ...]):
    with pytest.raises(TypeError):
        checked(total)(*arguments)


def test_two_numbers_for_one_letter_are_named():
    with pytest.raises(TypeError, match=r"N=4"):
        checked(total)(np.ones((4, 3)), np.ones(5))


def test_a_result_of_another_shape_is_refused():
    def flat(a: Float[np.ndarray, "N 3"]) -> Float[np.ndarray, "N 3"]:
        return a.ravel()

    with pytest.raises(TypeError, match="return"):
        checked(flat)(np.ones((4, 3)))


def test_a_letter_is_another_number_in_the_next_call_and_within_a_call():
    inner = checked(total)

    def outer(a: Float[np.ndarray, "N 3"], b: Float[np.ndarray, "N"]) -> Float[np.ndarray, "3"]:
        return inner(a[1:]) + inner(np.ones((7, 3)))

    assert checked(outer)(np.ones((4, 3)), np.ones(4)).tolist() == [10.0] * 3
    assert checked(outer)(np.ones((5, 3)), np.ones(5)).tolist() == [11.0] * 3


def test_a_generator_is_held_against_its_shapes_when_it_is_called():
    with pytest.raises(TypeError, match="N=4"):
        checked(halves)(np.ones(4), np.ones(6))


def test_a_letter_of_a_generator_is_not_that_of_who_asks_it():
    parts = checked(halves)

    def lengths(a: Float[np.ndarray, "N"]) -> list[int]:
        return [half.size for half in parts(np.ones(6))]

    assert checked(lengths)(np.ones(5)) == [3, 3]


def test_arrays_within_tuples_and_dicts_are_checked():
    def pairs(a: tuple[Float[np.ndarray, "N"], Float[np.ndarray, "N"]], b: dict[str, Float[np.ndarray, "3"]]) -> None:
        pass

    checked(pairs)((np.ones(2), np.ones(2)), {"b": np.ones(3)})
    for a, b in (((np.ones(2), np.ones(3)), {}), ((np.ones(2), np.ones(2)), {"b": np.ones(4)})):
        with pytest.raises(TypeError):
            checked(pairs)(a, b)


def test_errors_of_the_function_itself_are_its_own():
    def failing(a: Float[np.ndarray, "N"]) -> None:
        raise KeyError("its own")

    with pytest.raises(KeyError, match="its own"):
        checked(failing)(np.ones(2))


def test_a_dataclass_is_held_against_its_shapes():
    with pytest.raises(TypeError):
        checked(Pair)(np.ones(2), np.ones(3))


def test_what_has_no_arrays_is_left_as_it_is():
    def plain(a: int, b: list[int], c: str = "") -> dict[str, int]:
        return {}

    assert checked(plain) is plain


@pytest.mark.skipif(os.environ.get("RINGLIGHT_TESTS") == "unchecked", reason="this run of the suite checks no shapes")
def test_the_package_is_checked():
    with pytest.raises(TypeError, match="position"):
        view_directions(torch.ones(2, 3), torch.ones(4))
    with pytest.raises(TypeError, match="world_to_camera"):
        Camera(torch.eye(3), (50.0, 50.0), (16.0, 16.0), 32, 32)
