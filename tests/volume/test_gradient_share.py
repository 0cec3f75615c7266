"""A share of the samples hands gradients on, and the mean of what they hand on is the whole gradient."""

import pytest
import torch
from hypothesis import given, settings
from hypothesis import strategies as st

from ringlight import _kernels
from ringlight.core.importance_sampling import importance_weights
from ringlight.core.want import Want
from ringlight.data.rays import RayBatch
from ringlight.volume import model as of_model
from ringlight.volume.model import VolumeModel
from ringlight.volume.native_march import drawn_rows
from volume.volumes import BACKGROUND, rays, volume, volume_of_trains

RAYS = 300


@settings(max_examples=40, derandomize=True, deadline=None)
@given(
    count=st.integers(0, 300),
    width=st.sampled_from([1, 3]),
    share=st.sampled_from([0.1, 0.5, 1.0]),
    seed=st.integers(0, 1000),
)
def test_the_kernel_draws_what_the_reference_draws(count: int, width: int, share: float, seed: int):
    noise = torch.randn(count, width, generator=torch.Generator().manual_seed(seed))
    gradient = noise * noise[:, :1].exp() * (noise[:, :1] > -0.5)
    rows, handed_on = drawn_rows(gradient, share)
    weights = importance_weights(gradient, share)
    if share == 1:
        weights = (gradient.abs().sum(-1) > 0).float()
    assert rows.tolist() == weights.nonzero().flatten().tolist()
    assert torch.equal(handed_on, (gradient * weights[:, None])[weights > 0])


def gradient_of(model: VolumeModel, scale: float) -> tuple[torch.Tensor, int]:
    """By all parameters, of a lot of rays whose gradient has this scale; and how many parameters have one."""
    batch = RayBatch(rays(RAYS), torch.zeros(RAYS, 3), BACKGROUND)
    upstream = torch.randn(RAYS, 3, generator=torch.Generator().manual_seed(7))
    found = model.predict(batch, Want.GRADIENTS).backward(upstream * scale, {})
    whole = torch.cat([gradient.flatten() for _, gradient in sorted(found.items())]) / scale
    return whole, int(whole.count_nonzero())


@pytest.mark.parametrize("make", [volume, volume_of_trains])
@pytest.mark.parametrize("native", [True, False])
def test_the_mean_gradient_is_the_whole_one(make, native: bool, monkeypatch: pytest.MonkeyPatch):
    """Scales are lots: the start of a draw is made of the gradient's last bits."""
    monkeypatch.setattr(of_model, "runs_native", lambda *_: native)
    model, rounds = make(), 24
    whole, touched = gradient_of(model, 1.0)
    model.gradient_share = 0.25
    drawn = [gradient_of(model, 1 + 1e-4 * k) for k in range(rounds)]
    assert all(some <= touched for _, some in drawn)
    off = torch.stack([(gradient - whole).norm() for gradient, _ in drawn]).mean()
    of_mean = (torch.stack([gradient for gradient, _ in drawn]).mean(0) - whole).norm()
    assert 0 < off < 0.5 * whole.norm()
    assert of_mean < 2 * off / rounds**0.5, "what is left of independent lots' differences, with room for luck"


def test_kernels_refuse_shares_and_rows_that_cannot_be():
    rows, weights = torch.zeros(4, dtype=torch.int32), torch.zeros(4)
    for share in (0.0, 1.5, float("nan")):
        with pytest.raises(ValueError, match="a share is more than 0, at most 1"):
            _kernels.volume_draw(torch.ones(4, 3), share, rows, weights)
    with pytest.raises(ValueError, match="room for all"):
        _kernels.volume_draw(torch.ones(5, 3), 0.5, rows, weights)
    with pytest.raises(ValueError, match="one to three numbers"):
        _kernels.volume_draw(torch.ones(4, 4), 0.5, rows, weights)
