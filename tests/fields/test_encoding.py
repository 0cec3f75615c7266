import math

import pytest
import torch

from ringlight.errors import RecipeError
from ringlight.fields.encoding import FourierCode, fourier_features
from ringlight.fields.ring_settings import RingSettings


@pytest.mark.parametrize("identity", [True, False])
@pytest.mark.parametrize("pi", [True, False])
def test_columns_are_values_then_sines_then_cosines(pi: bool, identity: bool):
    values, code = torch.tensor([[0.25, -0.5]], dtype=torch.float64), FourierCode(2, pi, identity)
    encoded = fourier_features(values, code)[0]
    expected, scale = [0.25, -0.5] if identity else [], math.pi if pi else 1.0
    for value in (0.25, -0.5):
        expected += [math.sin(scale * value), math.sin(2 * scale * value)]
        expected += [math.cos(scale * value), math.cos(2 * scale * value)]
    assert encoded.shape == (code.width(2),)
    torch.testing.assert_close(encoded, torch.tensor(expected, dtype=torch.float64))


def test_no_bands_leave_the_values():
    values = torch.rand(4, 3)
    assert torch.equal(fourier_features(values, FourierCode(0)), values)


def test_widths_of_the_paper():
    assert [FourierCode(10).width(inputs) for inputs in (1, 3)] == [21, 63]
    assert [FourierCode(10, identity=False).width(inputs) for inputs in (1, 3)] == [20, 60]


@pytest.mark.parametrize("bands", [{"bands": 0}, {"view_bands": 0}])
def test_a_code_of_nothing_is_refused(bands: dict[str, int]):
    with pytest.raises(RecipeError, match="the heads would see nothing"):
        RingSettings(code_identity=False, **bands)
