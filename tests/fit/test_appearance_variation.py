"""Total variation of a volume's appearance: places, its value by hand, and that steps against it make it smoother."""

import pytest
import torch
from torch import Tensor, nn

from ringlight.core.rendering import Rendering
from ringlight.fit.regularizers.appearance_variation import DRAWN, EVERY, AppearanceVariation, neighbours
from ringlight.volume.occupancy import packed
from volume.volumes import volume, volume_of_trains

NOTHING = Rendering(torch.zeros(0, 3), torch.zeros(0, 1))


class Slopes(nn.Module):
    """Features rise by ``rise`` [3 F] along x, y and z of the box."""

    def __init__(self, rise: Tensor, intervals: tuple[int, int, int]):
        super().__init__()
        self.rise, self.intervals = nn.Parameter(rise), intervals

    def appearance(self, points: Tensor) -> Tensor:
        return points @ self.rise


def test_pairs_are_one_node_apart_along_an_axis_and_in_cells_that_rays_do_not_skip():
    model = volume()
    here, there = neighbours(model, 3, 8)
    assert model.is_kept(here).all()
    assert 0.5 * DRAWN < len(here) < 0.9 * DRAWN
    apart, pitches = there - here, 1 / torch.tensor(model.intervals)
    assert ((apart > 0).sum(1) <= 1).all()
    inside = (there < 1).all(1)
    assert torch.allclose(apart[inside].amax(1), pitches[apart[inside].argmax(1)], atol=1e-6)
    assert there.max() <= 1
    assert set(apart[inside].argmax(1).tolist()) == {0, 1, 2}


def test_other_steps_and_seeds_draw_other_places():
    model = volume()
    drawn = [neighbours(model, seed, step)[0] for seed, step in ((3, 8), (3, 8), (3, 12), (4, 8))]
    assert torch.equal(drawn[0], drawn[1])
    assert all(not torch.equal(drawn[0][:50], other[:50]) for other in drawn[2:])


def test_its_value_is_the_mean_rise_over_a_node_and_counts_for_the_steps_without_it():
    model = volume()
    rise = torch.tensor([[1.0, -2.0], [3.0, 0.5], [0.0, 4.0]])
    model.field = Slopes(rise, (20, 10, 40))
    here, there = neighbours(model, 0, 4)
    by_hand = EVERY * 0.3 * ((there - here) @ rise).abs().mean()
    term = AppearanceVariation(0.3, 0).term(4, model, NOTHING)
    assert term.value.item() == pytest.approx(by_hand.item(), rel=1e-5)
    each = (rise.abs().sum(1) / torch.tensor([20.0, 10.0, 40.0])).mean() / 2
    assert term.value.item() == pytest.approx(EVERY * 0.3 * each.item(), rel=0.1)
    assert [step for step in range(1, 13) if AppearanceVariation(1.0, 0).looks(step)] == [4, 8, 12]


def test_steps_against_its_gradient_make_appearance_smoother_and_leave_density_alone():
    model = volume_of_trains()
    regularizer = AppearanceVariation(1.0, 0)
    first = regularizer.term(4, model, NOTHING)
    assert all(name.startswith("field.appearance_train.") for name in first.grad_parameters)
    with torch.no_grad():
        for name, gradient in first.grad_parameters.items():
            model.get_parameter(name).sub_(1e-3 * gradient / gradient.norm())
    assert regularizer.term(4, model, NOTHING).value < first.value


def test_where_rays_skip_all_it_is_nothing():
    model = volume()
    model.occupied = packed(torch.zeros(2, 2, 8, dtype=torch.bool))
    term = AppearanceVariation(1.0, 0).term(4, model, NOTHING)
    assert term.value == 0
    assert not any(gradient.any() for gradient in term.grad_parameters.values())
