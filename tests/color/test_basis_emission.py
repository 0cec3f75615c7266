"""What Triton's kernels emit for a shared basis and a mirror with one: as torch does, with its gradients."""

import pytest
import torch
from torch import Tensor

import interpreted
from ringlight.color.basis_opacities import BasisOpacities
from ringlight.color.contract import ColorModel
from ringlight.color.mirror import FLIP_BELOW, Mirror
from ringlight.color.shared_basis import SharedBasis
from ringlight.color.varying_mirror import VaryingMirror
from ringlight.core.camera import Camera
from ringlight.core.directions import normalize, view_directions
from ringlight.core.gaussians import Gaussians
from ringlight.core.gradients import Gradients, dense
from ringlight.core.want import Want

CHOOSING = ("basis_opacities", "mirror", "shared_basis", "varying_mirror")
"""Modules that choose between Triton's kernels and others."""

SIZE, LATENTS = 5, 3


def camera() -> Camera:
    pose = torch.eye(4)
    pose[:3, :3] = torch.linalg.qr(torch.randn(3, 3, generator=torch.Generator().manual_seed(3)))[0]
    pose[:3, 3] = torch.tensor([0.1, -0.4, 3.0])
    return Camera(pose, (60.0, 60.0), (32.0, 32.0), 64, 64)


def table(count: int) -> Gaussians:
    """No normal whose turn is decided by rounding; one of no length."""
    drawn = torch.Generator().manual_seed(count)
    draw = lambda *shape: torch.randn(*shape, generator=drawn)  # noqa: E731
    means, normals = draw(count, 3), draw(count, 3)
    towards = -view_directions(means, camera().position)
    doubtful = ((normalize(normals) * towards).sum(-1, keepdim=True) - FLIP_BELOW).abs() < 1e-4
    normals = torch.where(doubtful, towards, normals)
    normals[0] = 0
    appearance = {
        "sh_dc": 2 * draw(count, 3),
        "base": draw(count, 3),
        "normals": normals,
        "latents": draw(count, LATENTS),
        "basis_weights": 0.5 * draw(count, SIZE),
    }
    return Gaussians(means, draw(count, 3), draw(count, 4), draw(count), appearance)


MODELS = {
    "colours": lambda: SharedBasis(SIZE),
    "opacities": lambda: BasisOpacities(SIZE),
    "plain mirror": lambda: Mirror(LATENTS),
    "mirror": lambda: VaryingMirror(LATENTS, SIZE),
    "mirror, opacities": lambda: VaryingMirror(LATENTS, SIZE, opacities=True),
}


def moved(gaussians: Gaussians, to: torch.dtype | torch.device) -> Gaussians:
    return Gaussians.from_columns({name: column.to(to) for name, column in gaussians.columns().items()})


def outcome(model: ColorModel, gaussians: Gaussians) -> dict[str, Tensor]:
    """Channels, factors and gradients by name."""
    emission, into = model.emit(gaussians, camera(), list(model.emits), Want.GRADIENTS), Gradients()
    drawn = torch.Generator().manual_seed(0)
    upstream = torch.randn(emission.channels.shape, generator=drawn, dtype=torch.float64)
    factors = emission.opacity_factor
    by_factors = None if factors is None else torch.randn(factors.shape, generator=drawn, dtype=torch.float64)
    emission.backward(
        upstream.to(emission.channels), None if by_factors is None else by_factors.to(emission.channels), into
    )
    found = {name: dense(gradient) for name, gradient in into.items()} | {"channels": emission.channels}
    return found if factors is None else found | {"factors": factors}


@pytest.mark.parametrize("kind", MODELS)
@pytest.mark.parametrize("degree", [0, 3])
def test_equals_torch_in_double(kind: str, degree: int, monkeypatch: pytest.MonkeyPatch):
    gaussians, model = table(150), MODELS[kind]()
    if not kind.startswith("plain"):
        getattr(model, "varying", model).active_degree.fill_(degree)
    expected = outcome(model.double(), moved(gaussians, torch.float64))
    for module in CHOOSING:
        monkeypatch.setattr(f"ringlight.color.{module}.runs_triton", lambda *_: True)
    found = outcome(model.float().to(interpreted.DEVICE), moved(gaussians, interpreted.DEVICE))
    for name, truth in expected.items():
        # Where nothing is shown of a parameter, no gradient is said for it, or zeros are.
        mine = found.get(name, torch.zeros_like(truth)).cpu().double()
        scale = truth.abs().max().item()
        torch.testing.assert_close(mine, truth.detach(), rtol=0, atol=4e-5 * scale + 1e-9, msg=name)
    assert all((found[name] == 0).all() for name in found.keys() - expected.keys())


@pytest.mark.parametrize("kind", MODELS)
def test_a_picture_is_emitted_without_a_way_back(kind: str, monkeypatch: pytest.MonkeyPatch):
    gaussians, model = table(70), MODELS[kind]()
    names = list(model.emits)
    expected = model.emit(gaussians, camera(), names, Want.EXACT)
    for module in CHOOSING:
        monkeypatch.setattr(f"ringlight.color.{module}.runs_triton", lambda *_: True)
    ours = model.to(interpreted.DEVICE).emit(moved(gaussians, interpreted.DEVICE), camera(), names, Want.EXACT)
    torch.testing.assert_close(ours.channels.cpu(), expected.channels.detach(), rtol=1e-5, atol=1e-5)
    assert (ours.opacity_factor is None) == (expected.opacity_factor is None)
    if expected.opacity_factor is not None:
        torch.testing.assert_close(ours.opacity_factor.cpu(), expected.opacity_factor, rtol=1e-5, atol=1e-5)
