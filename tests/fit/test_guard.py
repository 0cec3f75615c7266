"""A light that collapses is noticed and undone, and nothing else is."""

import math
from collections.abc import Callable, Mapping
from typing import Any

import pytest
import torch
from torch import Tensor

from ringlight.core.light_features import FeatureShares
from ringlight.core.rendering import Rendering
from ringlight.fit import guard as module
from ringlight.fit.guard import (
    BY_FEATURES,
    BY_LOSS,
    CHECK_EVERY,
    COLLAPSED,
    GOOD,
    MOST_UNDONE,
    PATIENCE,
    RISE,
    SLOWER,
    TOO_MANY_OFF,
    Collapse,
    Guard,
    sentences,
)
from ringlight.fit.optimizer import Optimizer
from ringlight.fit.strategies.densify_settings import DensifySettings
from ringlight.fit.strategies.stateless import Stateless
from ringlight.fit.train import Progress, Training, train
from ringlight.rasterize.choose import rasterizer_for
from small_recipes import TRAINED, small
from tiny_scene import tiny_scene

BEGINS = 150
GUARDED = ("ringlight-ring", "ringlight-mirror")
FINE, GONE = FeatureShares(0.0, 0.0, 0.0), FeatureShares(1.0, 0.0, 0.0)

Look = Callable[[int], FeatureShares | None]


class Run:
    """A guard that hears of steps, whose training's state is nothing but its step."""

    def __init__(self, look: Look = lambda _: FINE, disturbed: frozenset[int] = frozenset()):
        self.guard, self.step = Guard(("color.",), BEGINS, look, disturbed), 0

    def state(self) -> Mapping[str, Tensor]:
        return {"step": torch.tensor(self.step)}

    def until(self, last: int, loss: Callable[[int], float], most: int = 99) -> list[int]:
        """Go on to this step, or until the guard wanted to go back so many times; the steps after which it did."""
        found: list[int] = []
        while self.step < last and len(found) < most:
            self.step += 1
            good = self.guard.watch(self.step, loss(self.step), self.state)
            if good is not None:
                found.append(self.step)
                self.step = int(good["step"])
        return found


def after(step: int, shares: FeatureShares) -> Look:
    """Fine in looks at steps up to this one, then these."""
    return lambda index: shares if BEGINS + index * CHECK_EVERY > step else FINE


def falling(step: int) -> float:
    return 1.0 / (1 + step / 500)


def test_a_healthy_run_is_left_alone():
    for look in (lambda _: FINE, lambda _: None, lambda _: FeatureShares(0.8, 0.8, 0.8)):
        run = Run(look)
        assert run.until(5000, falling) == []
        assert run.guard.collapses == []


def test_noise_below_the_bound_is_no_collapse():
    run = Run()
    assert (
        run.until(5000, lambda step: (0.97 * RISE if step // CHECK_EVERY % 3 else 1.0) * (1 + 0.2 * (-1) ** step)) == []
    )


@pytest.mark.parametrize(
    "shares",
    [FeatureShares(COLLAPSED, 0.0, 0.0), FeatureShares(0.0, COLLAPSED, 0.0), FeatureShares(0.0, 0.0, TOO_MANY_OFF)],
)
def test_features_that_stay_idle_are_a_collapse(shares: FeatureShares):
    last = BEGINS + (1 + PATIENCE) * CHECK_EVERY
    run = Run(after(BEGINS + CHECK_EVERY, shares))
    assert run.until(last, falling, most=1) == [last]
    assert run.guard.collapses == [Collapse(last, BEGINS + CHECK_EVERY, BY_FEATURES)]
    assert run.step == BEGINS + CHECK_EVERY


def test_features_that_come_back_are_none():
    run = Run(lambda index: GONE if index % PATIENCE else FINE)
    assert run.until(5000, falling) == []


def test_a_light_that_collapses_as_it_goes_on_is_set_back_to_what_it_was_drawn_as():
    run = Run(after(BEGINS, GONE))
    run.until(5000, falling, most=1)
    assert run.guard.collapses == [Collapse(BEGINS + PATIENCE * CHECK_EVERY, BEGINS, BY_FEATURES)]


def test_a_loss_that_rises_and_stays_up_is_one_after_some_looks():
    jump = BEGINS + 2 * CHECK_EVERY
    last = jump + PATIENCE * CHECK_EVERY
    run = Run()
    assert run.until(last, lambda step: 1.1 * RISE if step > jump else 1.0, most=1) == [last]
    assert run.guard.collapses == [Collapse(last, jump, BY_LOSS)]
    assert Run().until(last - 1, lambda step: 1.1 * RISE if step > jump else 1.0) == []


def test_a_loss_that_comes_down_again_is_none():
    jump = BEGINS + 2 * CHECK_EVERY
    run = Run()
    assert run.until(jump + 4 * CHECK_EVERY, lambda step: 9.0 if jump < step <= jump + CHECK_EVERY else 1.0) == []


@pytest.mark.parametrize("place", [0, 1, CHECK_EVERY // 2, CHECK_EVERY - 1])
def test_what_disturbs_a_loss_is_no_collapse(place: int):
    reset = BEGINS + 3 * CHECK_EVERY + place
    run = Run(disturbed=frozenset({reset}))
    assert run.until(reset + 10 * CHECK_EVERY, lambda step: 1.0 if step <= reset else 20.0 / (1 + (step - reset))) == []
    assert Run(disturbed=frozenset({reset})).until(reset + 5000, lambda step: 1.0 if step <= reset else 8.0) == []
    again = run.until(run.step + 5 * CHECK_EVERY, lambda step: 9.0)
    assert again, "what comes later is compared with what came after the reset"


def test_a_state_whose_features_are_leaving_is_not_kept():
    leaving = FeatureShares(GOOD + 0.01, 0.0, 0.0)
    shares = [FINE, FINE, leaving, leaving, GONE]
    run = Run(lambda index: shares[min(index, 4)])
    run.until(5000, falling, most=1)
    last = BEGINS + (3 + PATIENCE) * CHECK_EVERY
    assert run.guard.collapses == [Collapse(last, BEGINS + CHECK_EVERY, BY_FEATURES)]


def test_losses_that_are_no_numbers_are_not_counted():
    run = Run()
    assert run.until(4000, lambda step: math.nan if step % 3 else falling(step)) == []
    assert all(tensor.isfinite().all() for tensor in run.guard.state().values())


def test_before_the_light_is_on_nothing_is_looked_at():
    def look(index: int) -> FeatureShares:
        raise AssertionError

    run = Run(look)
    run.until(BEGINS, lambda step: 1.0 if step < 50 else 99.0)
    assert run.guard.bytes_kept > 0


def test_after_so_many_times_it_is_kept_and_said_once():
    run = Run(lambda _: GONE)
    undone = run.until(4000, falling)
    assert undone == [BEGINS + PATIENCE * CHECK_EVERY] * MOST_UNDONE
    assert run.step == 4000
    assert run.guard.is_over
    assert run.guard.bytes_kept == 0
    *earlier, last = sentences(run.guard.collapses)
    assert len(earlier) == MOST_UNDONE
    for number, sentence in enumerate(earlier, start=1):
        for part in (
            f"step {BEGINS + PATIENCE * CHECK_EVERY}",
            f"back to step {BEGINS}",
            f"{SLOWER**number:g} of the light's",
        ):
            assert part in sentence
    assert "kept as it is" in last


def test_the_good_state_is_a_copy():
    numbers = torch.arange(3.0)
    guard = Guard(("color.",), 1, lambda _: GONE)
    assert guard.watch(1, 1.0, lambda: {"step": torch.tensor(1), "numbers": numbers}) is None
    numbers += 7
    last = 1 + PATIENCE * CHECK_EVERY
    for step in range(2, last):
        assert guard.watch(step, 1.0, dict) is None
    good = guard.watch(last, 1.0, dict)
    assert good is not None
    assert good["numbers"].tolist() == [0, 1, 2]


@pytest.mark.parametrize("stop", [BEGINS - 1, BEGINS, BEGINS + 1, 777, 1400, BEGINS + 6 * CHECK_EVERY, 1600])
def test_a_restored_guard_goes_on_alike(stop: int):
    def loss(step: int) -> float:
        return 3.0 if step > 1300 else falling(step)

    whole, first, second = (Run(disturbed=frozenset({500, 1000})) for _ in range(3))
    ends = whole.until(stop, loss) + whole.until(6000, loss)
    found = first.until(stop, loss)
    second.guard.restore({name: tensor.clone() for name, tensor in first.guard.state().items()})
    second.step = first.step
    assert found + second.until(6000, loss) == ends
    assert ends
    assert second.guard.collapses == whole.guard.collapses


# In training


@pytest.fixture
def hurried(monkeypatch: pytest.MonkeyPatch) -> None:
    """A look every four steps."""
    monkeypatch.setattr(module, "CHECK_EVERY", 4)
    monkeypatch.setattr(module, "FEWEST_LOSSES", 2)


STEPS, SPOILED = 40, 18
"""The light of these runs is on after step 8 or 4, and is looked at at 12, 16, 20 and 24."""


class Spoil(Stateless):
    """Once breaks a light as high rates do; a light whose rates were lowered is left alone."""

    most = None

    def __init__(self, training: Training):
        self.training = training

    def update(self, step: int, model: Any, optimizer: Optimizer, prediction: Rendering) -> None:
        if step != SPOILED or self.training.guard.collapses:
            return
        with torch.no_grad():
            if hasattr(model.color, "ring"):
                model.color.ring.core.mul_(1e9)
            else:
                model.shader.mlp[0].bias.fill_(-1e9)
                model.shader.mlp[2].bias.fill_(-1e9)


def training_of(method: str, spoiled: bool = False, **settings: object) -> Training:
    resets = 0 if method == "ringlight-mirror" else 12  # a mirror has none; no pixel is opaque enough after one
    densify = DensifySettings(threshold=1e-5, begin=4, every=5, stop=0.8, reset_every=resets, max_gaussians=900)
    looks = {"warmup": 0.1} if method == "ringlight-mirror" else {}  # lit after step 4, so looked at every fourth
    recipe = small(method, steps=STEPS, densify=densify, **looks, **settings)
    training = recipe.build(tiny_scene(views=4, size=16), rasterizer_for("auto"), seed=0)
    if spoiled:
        training.strategies = (*training.strategies, Spoil(training))
    return training


def copied(state: Mapping[str, Tensor]) -> dict[str, Tensor]:
    return {name: tensor.detach().clone() for name, tensor in state.items()}


def same(one: Mapping[str, Tensor], other: Mapping[str, Tensor]) -> bool:
    return one.keys() == other.keys() and all(torch.equal(one[name], other[name]) for name in one)


def without_guard(state: Mapping[str, Tensor]) -> dict[str, Tensor]:
    return {name: tensor for name, tensor in state.items() if not name.startswith("guard.")}


@pytest.mark.usefixtures("hurried")
@pytest.mark.parametrize("method", GUARDED)
def test_a_collapse_is_undone_to_the_bit_and_the_light_goes_on_more_slowly(method: str):
    training = training_of(method, spoiled=True)
    good: dict[str, Tensor] = {}
    steps: list[Progress] = []
    for progress in train(training):
        steps.append(progress)
        if progress.step == 16 and not good:
            good = copied(training.state())
        if progress.collapse is not None:
            assert training.step == 16
            assert same(without_guard(training.state()), without_guard(good))
    assert [p.step for p in steps] == [*range(1, 25), *range(17, STEPS + 1)]
    assert [p.step for p in steps if p.collapse is not None] == [24]
    other = training_of(method, undo_collapse=False)
    other.restore(good)
    light = ("shader.",) if method == "ringlight-mirror" else ("color.",)
    other.optimizer.slow(light, SLOWER)
    for _ in train(other):
        pass
    assert same(without_guard(training.state()), other.state())


@pytest.mark.usefixtures("hurried")
@pytest.mark.parametrize("method", GUARDED)
def test_a_run_that_is_stopped_around_a_collapse_goes_on_with_the_same_bits(method: str):
    whole = training_of(method, spoiled=True)
    saved: list[dict[str, Tensor]] = []
    for number, _ in enumerate(train(whole), start=1):
        if number in (15, 19, 22, 24, 26, 34):  # before it, twice after it, as it is undone, and twice later
            saved.append(copied(whole.state()))
    assert len(saved) == 6
    for state in saved:
        resumed = training_of(method, spoiled=True)
        resumed.restore(state)
        for _ in train(resumed):
            pass
        assert same(resumed.state(), whole.state())


@pytest.mark.usefixtures("hurried")
def test_only_the_lights_rates_are_lowered():
    training = training_of("ringlight-ring", spoiled=True)
    rates = training.optimizer._slowed
    assert set(rates.values()) == {1.0}
    for _ in train(training):
        pass
    assert {name for name, factor in rates.items() if factor == 1.0} == {n for n in rates if n.startswith("columns.")}
    assert set(rates.values()) == {1.0, SLOWER}


@pytest.mark.usefixtures("hurried")
@pytest.mark.parametrize("method", GUARDED)
def test_a_healthy_run_has_the_same_bits_without_it(method: str):
    ends = []
    for guarded in (True, False):
        training = training_of(method, undo_collapse=guarded)
        assert all(progress.collapse is None for progress in train(training))
        assert (training.guard is not None) == guarded
        ends.append(without_guard(training.state()))
    assert same(*ends)


@pytest.mark.usefixtures("hurried")
def test_what_it_keeps_is_counted():
    training = training_of("ringlight-ring")
    sizes = [training.bytes_by_part()["good state"] for _ in train(training)]
    assert not any(sizes[:7])
    assert all(sizes[8:])
    assert training_of("3dgs").bytes_by_part().keys() == {"parameters", "moments", "strategies", "photographs"}


def test_methods_without_a_neural_light_have_none_and_the_paper_neither():
    assert {method for method in TRAINED if training_of(method).guard is not None} == set(GUARDED)
