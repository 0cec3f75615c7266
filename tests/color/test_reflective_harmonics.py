"""The kernel of base colours, normals and strengths against torch, whichever axis is the shortest."""

import pytest
import torch
from torch import Tensor

from ringlight.color.reflective_harmonics import ReflectiveHarmonics
from ringlight.core.camera import Camera
from ringlight.core.gaussians import Gaussians
from ringlight.core.gradients import Gradients, dense
from ringlight.core.scene import PointCloud
from ringlight.core.want import Want

ROUNDING = 1e-5
"""Of the largest value: float32 against float64."""

VIEW = Camera(torch.eye(4), (60.0, 60.0), (32.0, 32.0), 64, 64)


def table_of(count: int) -> tuple[ReflectiveHarmonics, Gaussians]:
    drawn = torch.Generator().manual_seed(count)
    model = ReflectiveHarmonics()
    means = torch.randn(count, 3, generator=drawn) + torch.tensor([0.0, 0.0, 4.0])
    columns = model.new_columns(PointCloud(means, 0.3 + 0.4 * torch.rand(count, 3, generator=drawn)))
    columns = {
        name: column + 0.3 * torch.randn(column.shape, generator=drawn) if name != "sh_dc" else column
        for name, column in columns.items()
    }
    scales, quats = torch.randn(count, 3, generator=drawn) - 3, torch.randn(count, 4, generator=drawn)
    return model, Gaussians(means, scales, quats, torch.zeros(count), columns)


def result(model: ReflectiveHarmonics, table: Gaussians) -> tuple[Tensor, dict[str, Tensor]]:
    """Channels, and the gradients of a random sum of them."""
    emission, into = model.emit(table, VIEW, tuple(model.emits), Want.GRADIENTS), Gradients()
    drawn = torch.Generator().manual_seed(1)
    upstream = torch.randn(emission.channels.shape, generator=drawn, dtype=torch.float64).to(emission.channels)
    emission.backward(upstream, None, into)
    return emission.channels, {name: dense(gradient) for name, gradient in into.items()}


@pytest.mark.parametrize("count", [1, 15, 16, 17, 300])
def test_equals_the_reference(count: int) -> None:
    model, table = table_of(count)
    assert count < 300 or len(table.log_scales.argmin(-1).unique()) == 3
    channels, gradients = result(model, table)
    double = Gaussians.from_columns({name: column.double() for name, column in table.columns().items()})
    expected, slopes = result(model.double(), double)
    torch.testing.assert_close(channels.double(), expected, rtol=0, atol=ROUNDING)
    assert gradients.keys() == slopes.keys()
    for name, slope in slopes.items():
        assert (gradients[name] - slope).abs().max() <= ROUNDING * slope.abs().max().clamp_min(1.0), name
