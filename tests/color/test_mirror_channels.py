"""The channels of deferred shading by the kernel and by torch, in value and gradient."""

import pytest
import torch

from ringlight.color.mirror import FLIP_BELOW, Mirror
from ringlight.core.camera import Camera
from ringlight.core.directions import normalize, view_directions
from ringlight.core.gaussians import Gaussians
from ringlight.core.kernel_limits import MIRROR_MAX_LATENTS
from torch_graph import channels

COLUMNS = ("base", "normals", "latents")


def camera() -> Camera:
    pose = torch.linalg.qr(torch.randn(4, 4, generator=torch.Generator().manual_seed(3)))[0]
    pose[:3, :3] = torch.linalg.qr(pose[:3, :3])[0]
    pose[3], pose[2, 3] = torch.tensor([0.0, 0, 0, 1]), 4.0
    return Camera(pose, (60.0, 60.0), (32.0, 32.0), 64, 64)


def table(count: int, latents: int) -> Gaussians:
    """Normals in all directions and of all lengths, none where the turn is decided by rounding."""
    drawn = torch.Generator().manual_seed(count)
    means, base, normals = (torch.randn(count, 3, generator=drawn) for _ in range(3))
    towards = -view_directions(means, camera().position)
    doubtful = ((normalize(normals) * towards).sum(-1, keepdim=True) - FLIP_BELOW).abs() < 1e-4
    appearance = {
        "base": 2 * base,
        "normals": torch.where(doubtful, towards, normals),
        "latents": torch.randn(count, latents, generator=drawn),
    }
    return Gaussians(means, torch.zeros(count, 3), torch.ones(count, 4), torch.zeros(count), appearance)


def outcome(gaussians: Gaussians, with_depth: bool) -> tuple[dict[str, torch.Tensor], dict[str, torch.Tensor | None]]:
    leaves = {name: column.detach().clone().requires_grad_() for name, column in gaussians.columns().items()}
    mirror = Mirror(gaussians.appearance["latents"].shape[1])
    emitted = channels(mirror, Gaussians.from_columns(leaves), camera())
    drawn = torch.Generator().manual_seed(0)
    upstream = {name: torch.randn(c.shape, generator=drawn, dtype=torch.float64) for name, c in emitted.items()}
    if not with_depth:
        upstream["depth"].zero_()
    torch.autograd.backward(list(emitted.values()), [upstream[name].to(c) for name, c in emitted.items()])
    return emitted, {name: leaves[name].grad for name in ("means", *COLUMNS)}


@pytest.mark.parametrize("count", [0, 1, 15, 16, 17, 5000])
@pytest.mark.parametrize("latents", [0, 4, MIRROR_MAX_LATENTS, MIRROR_MAX_LATENTS + 1])
@pytest.mark.parametrize("with_depth", [False, True])
def test_equals_the_reference(count: int, latents: int, with_depth: bool):
    gaussians = table(count, latents)
    double = Gaussians.from_columns({name: column.double() for name, column in gaussians.columns().items()})
    (found, by_found), (expected, by_expected) = outcome(gaussians, with_depth), outcome(double, with_depth)
    assert list(found) == list(expected)
    for name, channel in expected.items():
        torch.testing.assert_close(found[name].double(), channel, rtol=1e-5, atol=1e-5, msg=name)
    for name in COLUMNS:
        largest = by_expected[name].abs().max().item() if by_expected[name].numel() else 0.0
        torch.testing.assert_close(by_found[name].double(), by_expected[name], rtol=1e-4, atol=1e-5 * largest)
    if with_depth and count:
        torch.testing.assert_close(by_found["means"].double(), by_expected["means"], rtol=1e-5, atol=1e-6)
    else:
        assert by_found["means"] is None or not by_found["means"].any()


def test_a_normal_without_length_stays_and_gets_a_finite_gradient():
    gaussians = table(5, 4)
    gaussians.appearance["normals"][2] = 0
    emitted, gradients = outcome(gaussians, False)
    assert not emitted["normal"][2].any()
    assert gradients["normals"].isfinite().all()


def test_what_is_not_finite_stays_in_its_row():
    gaussians = table(20, 4)
    gaussians.appearance["normals"][7, 1] = float("nan")
    emitted, _ = outcome(gaussians, False)
    others = torch.arange(20) != 7
    assert emitted["normal"][7].isnan().any()
    assert all(channel[others].isfinite().all() for channel in emitted.values())
