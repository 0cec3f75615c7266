"""The model that is kept is the mean of the last steps', and training itself does not know of it."""

import pytest
import torch

from contracts.methods import small
from ringlight.fit.strategies.average_at_end import AverageAtEnd
from ringlight.fit.train import Training, train
from ringlight.rasterize.choose import rasterizer_for
from tiny_scene import tiny_scene

STEPS, FIRST = 12, 8


def training_of(*strategies: AverageAtEnd) -> Training:
    training: Training = small("3dgs", STEPS).build(tiny_scene(views=4, size=16), rasterizer_for("auto"), 3)
    training.strategies = strategies
    return training


def after_each_step(training: Training) -> list[dict[str, torch.Tensor]]:
    return [
        {name: parameter.detach().clone() for name, parameter in training.model.named_parameters()}
        for _ in train(training)
    ]


def test_at_the_last_step_it_is_the_mean_and_before_that_nothing_changes() -> None:
    plain, averaged = after_each_step(training_of()), after_each_step(training_of(AverageAtEnd(FIRST, STEPS)))
    for step in range(STEPS - 1):
        assert all(torch.equal(plain[step][name], averaged[step][name]) for name in plain[step])
    for name, kept in averaged[-1].items():
        mean = torch.stack([models[name].double() for models in plain[FIRST - 1 :]]).mean(0)
        torch.testing.assert_close(kept.double(), mean, rtol=1e-5, atol=1e-6)
    assert any(not torch.equal(plain[-1][name], averaged[-1][name]) for name in plain[-1])


def test_means_are_kept_only_while_they_grow() -> None:
    average = AverageAtEnd(FIRST, STEPS)
    training = training_of(average)
    kept = [bool(average.state()) for _ in train(training)]
    assert kept == [FIRST <= step < STEPS for step in range(1, STEPS + 1)]


@pytest.mark.parametrize("added", [1, 3, STEPS])
def test_in_a_longer_run_it_is_the_mean_of_its_own_last_steps(added: int) -> None:
    share = (STEPS - FIRST + 1) / STEPS
    first = STEPS + added - max(round(share * added), 1) + 1
    training, plain = training_of(AverageAtEnd(FIRST, STEPS)), training_of(AverageAtEnd(FIRST, STEPS))
    for one in (training, plain):
        after_each_step(one)
        one.extend(added)
    plain.strategies = ()
    kept, models = after_each_step(training)[-1], after_each_step(plain)[first - STEPS - 1 :]
    assert_mean(kept, models)


def test_steps_that_are_added_in_its_midst_begin_it_anew() -> None:
    training, plain = training_of(AverageAtEnd(FIRST, STEPS)), training_of()
    for one in (training, plain):
        steps = train(one)
        while one.step < STEPS - 1:
            next(steps)
        one.extend(5)
    kept, models = after_each_step(training)[-1], after_each_step(plain)
    assert_mean(kept, models[-round(5 * (STEPS - FIRST + 1) / STEPS) :])


def assert_mean(kept: dict[str, torch.Tensor], models: list[dict[str, torch.Tensor]]) -> None:
    for name, values in kept.items():
        mean = torch.stack([model[name].double() for model in models]).mean(0)
        torch.testing.assert_close(values.double(), mean, rtol=1e-5, atol=1e-6)
