"""Total variation of planes and lines: its value by hand, and how it falls over a run."""

import pytest
import torch

from ringlight.core.want import Want
from ringlight.fit.regularizers.factor_variation import FactorVariation, variation
from ringlight.rasterize.choose import rasterizer_for
from small_recipes import small
from tiny_scene import tiny_scene


def test_it_is_the_mean_square_of_steps_along_each_axis():
    plane = torch.tensor([[0.0, 1.0], [3.0, 1.0], [3.0, 1.0]])[..., None]
    assert variation(plane).item() == pytest.approx((9 + 0 + 0 + 0) / 4 + (1 + 4 + 4) / 3)
    assert variation(plane[:, 0]).item() == pytest.approx(9 / 2)


def test_the_papers_weight_stands_in_front_of_two_hundredths_of_it():
    """The program of the paper has twice the sum of both means, and a hundredth of that."""
    training = small("tensorf").build(tiny_scene(views=2, size=12), rasterizer_for("cpu"), 0)
    model, name = training.model, "field.density_factors.planes.0"
    shown = model.predict(training.batches.at(1), Want.GRADIENTS)
    plane = model.get_parameter(name).detach()
    by_hand = 0.1 * 2 * (plane.diff(dim=0).square().mean() + plane.diff(dim=1).square().mean()).item() / 100
    term = FactorVariation((name,), weight=0.1, steps=10, end=0.1)
    for step, share in ((0, 1.0), (5, 0.1**0.5), (10, 0.1)):
        assert term.term(step, model, shown).value.item() == pytest.approx(share * by_hand, rel=1e-5)
