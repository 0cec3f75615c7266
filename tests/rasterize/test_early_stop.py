"""What stops early is said by the caller: by default every picture is exact, whatever is kept of it."""

from dataclasses import replace

import pytest
import torch
from torch import Tensor

from ringlight import _kernels
from ringlight.bench.workload import Size, workload, workload_camera
from ringlight.rasterize.contract import RasterOptions
from ringlight.rasterize.convention import EARLY_STOP
from ringlight.rasterize.cpu_job import Job, table_of


def drawn(channels: int, early_stop: bool) -> tuple[Tensor, Tensor, _kernels.Workspace, _kernels.SplatTable]:
    """Image, alpha and what the pass left, of twenty nearly opaque Gaussians for every pixel."""
    work = workload(Size(20_000, 96, channels))
    opaque = replace(work.gaussians, opacity_logits=torch.full_like(work.gaussians.opacity_logits, 1.0))
    job = Job(workload_camera(96), torch.zeros(channels), RasterOptions(), len(opaque))
    workspace, table = _kernels.Workspace(), table_of(opaque, work.channels, None)
    image, alpha = job.draw(workspace, table, early_stop=early_stop)
    return image, alpha, workspace, job.native(table)


@pytest.mark.parametrize("channels", [1, 3, 4, 11, 21])
def test_a_plain_picture_stops_early_when_asked(channels: int):
    exact, alpha, *_ = drawn(channels, early_stop=False)
    fast, fast_alpha, *_ = drawn(channels, early_stop=True)
    filled = fast_alpha - alpha
    assert filled.min() >= 0
    assert 0 < filled.max() < EARLY_STOP
    assert (fast - exact).abs().max() < EARLY_STOP * exact.abs().max()
    untouched = filled == 0
    assert torch.equal(fast[:, untouched], exact[:, untouched])


def test_there_is_no_gradient_after_an_early_stop():
    image, _, workspace, table = drawn(3, early_stop=True)
    rows = 20_000
    gradients = _kernels.SplatGradients(
        torch.empty(rows, 3), torch.empty(rows, 3), torch.empty(rows, 4), torch.empty(rows), None,
        torch.empty(rows, 3), torch.empty(rows, 2), None,
    )  # fmt: skip
    with pytest.raises(ValueError, match="backward needs"):
        workspace.backward(table, image, torch.ones_like(image), None, gradients)
