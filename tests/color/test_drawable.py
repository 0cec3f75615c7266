import pytest
import torch

from ringlight.color.drawable import drawable, drawable_rows
from ringlight.core.camera import Camera
from ringlight.core.gaussians import Gaussians


def camera() -> Camera:
    pose = torch.eye(4)
    pose[2, 3] = 4.0
    return Camera(pose, (100.0, 110.0), (33.0, 30.0), 64, 62)


def gaussians(means: list[list[float]], scale: float) -> Gaussians:
    count = len(means)
    return Gaussians(
        torch.tensor(means), torch.full((count, 3), scale).log(), torch.randn(count, 4), torch.zeros(count)
    )


def test_inside_outside_behind_and_broken():
    rows = [[0, 0, 0], [100, 0, 0], [0, -100, 0], [0, 0, -5], [float("nan"), 0, 0], [0, 0, float("inf")]]
    assert drawable(gaussians(rows, 0.01), camera()).tolist() == [True, False, False, False, False, False]


def test_large_gaussians_reach_into_the_image():
    assert drawable(gaussians([[4.0, 0, 0]], 0.01), camera()).tolist() == [False]
    assert drawable(gaussians([[4.0, 0, 0]], 1.5), camera()).tolist() == [True]


def test_no_pixel_is_touched_by_a_row_outside():
    """Every row left out is farther from the image than 3.4 sigma of its own projected covariance."""
    generator = torch.Generator().manual_seed(0)
    count = 4000
    means = torch.randn(count, 3, generator=generator) * 3
    log_scales = torch.randn(count, 3, generator=generator) - 2
    table = Gaussians(means, log_scales, torch.randn(count, 4, generator=generator), torch.zeros(count))
    view = camera()
    left_out = table.rows(~drawable(table, view) & (view.depths(means) > 0.01))
    assert len(left_out) > 100
    x, y, z = (left_out.means + view.world_to_camera[:3, 3]).unbind(-1)
    limit_x, limit_y = 1.3 * 0.5 * 64 / 100, 1.3 * 0.5 * 62 / 110
    tx, ty = (x / z).clamp(-limit_x, limit_x) * z, (y / z).clamp(-limit_y, limit_y) * z
    nothing = torch.zeros_like(z)
    jacobian = torch.stack([100 / z, nothing, -100 * tx / z**2, nothing, 110 / z, -110 * ty / z**2], -1)
    axes = left_out.rotations * left_out.scales[:, None, :]
    projected = jacobian.unflatten(-1, (2, 3)) @ axes
    covariance = projected @ projected.transpose(1, 2) + 0.3 * torch.eye(2)
    sigma_x, sigma_y = covariance[:, 0, 0].sqrt(), covariance[:, 1, 1].sqrt()
    u, v = 100 * x / z + 33, 110 * y / z + 30
    beyond_x = torch.maximum(-u, u - 64) > 3.4 * sigma_x
    beyond_y = torch.maximum(-v, v - 62) > 3.4 * sigma_y
    assert (beyond_x | beyond_y).all()


@pytest.mark.parametrize("count", [0, 1, 15, 16, 17, 20_000])
def test_kernel_lists_what_the_reference_marks(count):
    generator = torch.Generator().manual_seed(count)
    means = torch.randn(count, 3, generator=generator) * 3
    log_scales = torch.randn(count, 3, generator=generator) - 2
    broken = torch.rand(count, generator=generator) < 0.05
    means[broken, 1] = float("nan")
    table = Gaussians(
        means, log_scales, torch.randn(count, 4, generator=generator), 8 * torch.randn(count, generator=generator)
    )
    rows = drawable_rows(table, camera())
    assert rows.dtype == torch.int32
    assert torch.equal(rows.long(), drawable(table, camera()).nonzero()[:, 0])


def test_too_faint_to_change_a_picture():
    table = gaussians([[0.0, 0.0, 0.0]] * 3, 0.01)
    table.opacity_logits[:] = torch.tensor([1 / 255, 1 / 257, 0.5]).logit()
    assert drawable(table, camera()).tolist() == [True, False, True]
