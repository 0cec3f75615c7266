"""A training's curve: a hundred points at most, the same however often it is stopped, and without what was undone."""

import json
import math

import pytest
import torch
from hypothesis import given, settings
from hypothesis import strategies as st

from ringlight.core.rendering import Rendering
from ringlight.fit.train import Progress
from ringlight.runs.history import MOST_POINTS, SAMPLED, History


class Photograph:
    label = "view r_0"


def step(number: int, fault: str | None = None) -> Progress:
    picture = torch.full((2, 2, 3), 1 / (number + 1))
    return Progress(
        number,
        {"photometric": torch.tensor(1.0 / number)},
        Photograph(),
        Rendering(picture, torch.ones(2, 2, 1), {}),
        torch.zeros(2, 2, 3),
        fault,
    )


def noted(steps: int, last: int | None = None) -> History:
    history = History(steps)
    for number in range(1, (last or steps) + 1):
        history.note(step(number), number / 10, number * 2)
    return history


@settings(max_examples=20)
@given(steps=st.integers(1, 500))
def test_a_run_has_about_a_hundred_points(steps: int) -> None:
    found = noted(steps).points
    assert min(steps, MOST_POINTS // 2) <= len(found) <= MOST_POINTS
    assert [point.seconds for point in found] == [point.step / 10 for point in found]
    assert [point.counted for point in found] == [point.step * 2 for point in found]


def extended(steps: int, more: int, stops: tuple[int, ...] = ()) -> History:
    """A run of ``steps`` with ``more`` behind them, which goes on from a checkpoint after each of ``stops``."""
    history = History(steps)
    for number in range(1, steps + more + 1):
        history.note(step(number), number / 10, number * 2)
        if number in stops:
            again = History(steps)
            again.go_on_from({"history": history.to_text()})
            history = again
    return history


@settings(max_examples=10)
@given(steps=st.integers(1, 150), more=st.integers(1, 400), stops=st.tuples(st.integers(1, 550), st.integers(1, 550)))
def test_a_run_that_is_extended_far_has_no_more_points(steps: int, more: int, stops: tuple[int, ...]) -> None:
    found = extended(steps, more)
    assert len(found.points) <= MOST_POINTS
    *earlier, newest = [point.step for point in found.points]
    assert earlier == list(range(found.every, newest, found.every))
    assert steps + more - newest < found.every
    assert extended(steps, more, stops).points == found.points


def test_a_checkpoint_with_too_many_points_is_thinned() -> None:
    points = [[number, 1.0, 20.0, 5] for number in range(1, 451)]
    history = History(60)
    history.go_on_from({"history": json.dumps({"points": points, "sum": 0, "count": 0})})
    assert [point.step for point in history.points] == [*range(8, 449, 8), 450]


def test_a_point_is_the_mean_over_the_last_photographs() -> None:
    history = noted(1000)
    point = history.points[4]
    assert point.step == 50
    decibels = [20 * torch.tensor(float(number + 1)).log10().item() for number in range(51 - SAMPLED, 51)]
    assert point.psnr == pytest.approx(sum(decibels) / SAMPLED, rel=1e-5)


def test_a_point_has_the_mean_loss_of_its_photographs() -> None:
    point = noted(1000).points[4]
    assert point.loss == pytest.approx(sum(1 / number for number in range(51 - SAMPLED, 51)) / SAMPLED, rel=1e-5)


def test_a_checkpoint_of_before_the_loss_goes_on_without_one() -> None:
    history = History(60)
    history.go_on_from({"history": json.dumps({"points": [[1, 1.0, 20.0, 5]], "sum": 0, "count": 0})})
    assert [point.loss for point in history.points] == [None]
    history.note(step(2), 1.5, 5)
    assert history.points[-1].loss == pytest.approx(0.5)


@settings(max_examples=20)
@given(steps=st.integers(1, 300), share=st.floats(0, 1))
def test_a_history_goes_on_from_a_checkpoint(steps: int, share: float) -> None:
    stopped = noted(steps, last=max(int(share * steps), 1))
    again = History(steps)
    again.go_on_from({"history": stopped.to_text()})
    for number in range(max(int(share * steps), 1) + 1, steps + 1):
        again.note(step(number), number / 10, number * 2)
    assert again.points == noted(steps).points


def test_a_perfect_picture_is_kept_as_json() -> None:
    history = History(1)
    perfect = torch.zeros(2, 2, 3)
    history.note(Progress(1, {}, Photograph(), Rendering(perfect, torch.ones(2, 2, 1), {}), perfect), 0.1, 1)
    text = history.to_text()
    assert "Infinity" not in text
    again = History(1)
    again.go_on_from({"history": text})
    assert again.points == history.points
    assert again.points[0].psnr == float("inf")


def test_what_was_undone_is_forgotten() -> None:
    history = noted(300)
    for number in range(151, 301):
        history.note(step(number), 30 + number / 10, 7)
    assert [point.step for point in history.points] == [point.step for point in noted(300).points]
    assert all(point.counted == 7 for point in history.points if point.step > 150)


def test_what_was_undone_within_a_point_is_forgotten() -> None:
    history = noted(1000, last=58)
    for number in (*range(54, 61), *range(55, 61)):
        history.note(step(number), 1.0, 7)
    assert history.points[:-1] == noted(1000, last=50).points
    assert history.points[-1].psnr == noted(1000, last=60).points[-1].psnr


def test_a_photograph_that_was_not_finite_counts_not() -> None:
    history = History(100)
    history.note(step(1, "inf"), 0.1, 1)
    assert history.points == []


@pytest.mark.parametrize(
    "text",
    [
        "",
        "[]",
        "{}",
        '{"points": 3}',
        '{"points": [[1]], "sum": 0, "count": 0}',
        '{"points": [], "sum": 0, "count": 0, "every": 0}',
    ],
)
def test_damage_is_a_value_error(text: str) -> None:
    with pytest.raises(ValueError, match="history"):
        History(10).go_on_from({"history": text})
    History(10).go_on_from({})


def test_pixels_that_were_not_drawn_evenly_count_by_their_weights() -> None:
    picture, truth = torch.tensor([[0.1] * 3, [0.5] * 3]), torch.zeros(2, 3)
    shown = Rendering(picture, torch.ones(2, 1), {})
    history = History(1)
    history.note(Progress(1, {}, Photograph(), shown, truth, weights=torch.tensor([1.5, 0.5])), 0.1, 1)
    assert history.points[0].psnr == pytest.approx(-10 * math.log10((1.5 * 0.01 + 0.5 * 0.25) / 2))
