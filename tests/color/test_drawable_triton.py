"""Rows that could be drawn, by Triton's kernel against the reference."""

import pytest
import torch

import interpreted
from contracts.raster_cases import random_case
from ringlight.color.drawable import drawable, view_numbers
from ringlight.color.drawable_triton import drawable_by_triton


@pytest.mark.parametrize("seed", range(3))
@pytest.mark.filterwarnings("ignore:overflow", "ignore:invalid value", "ignore:divide by zero")
def test_equals_the_reference(seed: int):
    case = random_case(seed, count=900)
    table = case.gaussians
    table.means[:300] *= 8  # many off the image
    table.means[0], table.log_scales[1] = float("nan"), 80.0
    expected = drawable(table, case.camera)
    columns = (table.means, table.log_scales, table.opacity_logits)
    found = drawable_by_triton(*(column.to(interpreted.DEVICE) for column in columns), view_numbers(case.camera))
    assert 50 < int(expected.sum()) < 850
    assert torch.equal(found.cpu(), expected)
