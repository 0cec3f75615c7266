"""What stops early is said by the caller: by default every picture is exact, whatever is kept of it."""

from dataclasses import replace

import pytest
import torch
from torch import Tensor

from ringlight import _kernels
from ringlight.bench.workload import Size, workload, workload_camera
from ringlight.core.camera import Camera
from ringlight.core.gaussians import Gaussians
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


FAINT, FAINT_OPACITY = 300, 0.0145


def sheets(early_stop: bool, max_alpha: float) -> tuple[Tensor, Tensor]:
    """Black Gaussians over white: one that leaves 0.089 everywhere, an opaque one that finishes a single pixel there,
    and many faint ones behind both, which take the others past the threshold."""
    rows = [((0.0, 0.0), 1.0, 20.0, 0.911), ((-0.145, -0.145), 1.1, 0.003, 1 - 1e-9)]
    rows += [((0.0, 0.0), 1.5 + 0.01 * i, 20.0, FAINT_OPACITY) for i in range(FAINT)]
    depths = torch.tensor([depth for _, depth, _, _ in rows])
    across = torch.tensor([place for place, *_ in rows]) * depths[:, None]
    scales = torch.tensor([size for *_, size, _ in rows]) * depths
    gaussians = Gaussians(
        torch.cat([across, depths[:, None]], 1),
        scales.log()[:, None].repeat(1, 3),
        torch.eye(4)[:1].repeat(len(rows), 1),
        torch.tensor([opacity for *_, opacity in rows]).logit().clamp_max(20.0),
    )
    camera = Camera(torch.eye(4), (100.0, 100.0), (16.0, 16.0), 32, 32)
    job = Job(camera, torch.ones(3), RasterOptions(max_alpha=max_alpha), len(rows))
    return job.draw(_kernels.Workspace(), table_of(gaussians, torch.zeros(len(rows), 3), None), early_stop=early_stop)


@pytest.mark.parametrize("max_alpha", [0.999, 0.99995])
def test_a_pixel_that_is_finished_keeps_the_light_that_it_had_left(max_alpha: float):
    (exact, alpha), (fast, fast_alpha) = (sheets(early_stop, max_alpha) for early_stop in (False, True))
    assert 0.08 < exact[0, 1, 1] < 0.1, "finished before the opaque one, with this much of the background"
    assert (fast - exact).abs().max() < EARLY_STOP
    assert (fast_alpha - alpha).abs().max() < EARLY_STOP


def test_there_is_no_gradient_after_an_early_stop():
    image, _, workspace, table = drawn(3, early_stop=True)
    rows = 20_000
    gradients = _kernels.SplatGradients(
        torch.empty(rows, 3), torch.empty(rows, 3), torch.empty(rows, 4), torch.empty(rows), None,
        torch.empty(rows, 3), torch.empty(rows, 2), None,
    )  # fmt: skip
    with pytest.raises(ValueError, match="backward needs"):
        workspace.backward(table, image, torch.ones_like(image), None, gradients)
