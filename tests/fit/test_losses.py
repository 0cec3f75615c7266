import pytest
import torch
from hypothesis import given, settings
from hypothesis import strategies as st

from ringlight import _kernels
from ringlight.fit.losses.photometric_gradient import Target, photometric_gradient, photometric_reference, ssim_map
from ringlight.fit.photometric import PhotometricLoss

L1 = PhotometricLoss()
L2 = PhotometricLoss(pixel="l2", ssim_weight=0.35, scale=3.0)
both = pytest.mark.parametrize("loss", [L1, L2], ids=["l1", "l2"])


@pytest.fixture
def restore_threads():
    yield
    _kernels.set_threads(0)


def images(height: int, width: int, seed: int) -> tuple[torch.Tensor, torch.Tensor]:
    """A rendering that leaves [0, 1] here and there, and a target that is half flat, half noise; both planar."""
    generator = torch.Generator().manual_seed(seed)
    rendering = torch.rand(3, height, width, generator=generator) * 1.2 - 0.1
    target = torch.rand(3, height, width, generator=generator)
    target[:, : height // 2] = 1.0
    return rendering, target


def value_and_gradient(rendering: torch.Tensor, target: torch.Tensor, loss: PhotometricLoss):
    value, gradient = photometric_gradient(rendering.permute(1, 2, 0), Target(target), loss)
    return value, gradient.permute(2, 0, 1)


def assert_equals_reference(rendering: torch.Tensor, target: torch.Tensor, loss: PhotometricLoss):
    value, gradient = value_and_gradient(rendering, target, loss)
    leaf = rendering.double().requires_grad_()
    expected = photometric_reference(leaf, target.double(), loss)
    expected.backward()
    assert value.item() == pytest.approx(expected.item(), rel=2e-6)
    # float32 variances are differences of squares: 1e-7 of rounding beside C2 = 9e-4.
    scale = leaf.grad.abs().max().item()
    torch.testing.assert_close(gradient.double(), leaf.grad, rtol=0, atol=1e-4 * scale)


@both
@given(height=st.integers(1, 40), width=st.integers(1, 70), seed=st.integers(0, 2**31))
@settings(max_examples=40)
def test_kernel_equals_its_reference_at_any_size(loss, height, width, seed):
    assert_equals_reference(*images(height, width, seed), loss)


@both
@pytest.mark.parametrize(("height", "width"), [(101, 16), (100, 33), (207, 5), (305, 48)])
def test_strips_meet_without_a_seam(loss, height, width):
    assert_equals_reference(*images(height, width, seed=1), loss)


@both
def test_the_reference_has_the_gradient_of_finite_differences(loss):
    rendering, target = images(9, 13, seed=2)
    # The absolute value has a kink: keep away from it.
    rendering = torch.where((rendering - target).abs() < 0.01, rendering + 0.02, rendering)
    assert torch.autograd.gradcheck(
        lambda image: photometric_reference(image, target.double(), loss), rendering.double().requires_grad_()
    )


@both
def test_same_bits_for_any_number_of_threads(loss, restore_threads):
    rendering, target = images(310, 90, seed=3)
    results = []
    for threads in (1, 2, 4):
        _kernels.set_threads(threads)
        results.append(value_and_gradient(rendering, target, loss))
    for value, gradient in results[1:]:
        assert value == results[0][0]
        assert torch.equal(gradient, results[0][1])


@both
def test_equal_images_have_no_loss(loss):
    _, target = images(60, 80, seed=4)
    value, gradient = value_and_gradient(target, target, loss)
    assert value.item() == pytest.approx(0, abs=1e-6)
    assert gradient.abs().max().item() < 1e-6


def test_interleaved_memory_gives_the_same_loss_and_gradient():
    rendering, target = images(20, 30, seed=5)
    value, gradient = value_and_gradient(rendering, target, L1)
    interleaved, by_color = photometric_gradient(rendering.permute(1, 2, 0).contiguous(), Target(target), L1)
    assert interleaved.item() == value.item()
    assert torch.equal(by_color.permute(2, 0, 1), gradient)


def test_gradient_of_a_planar_rendering_is_planar():
    rendering, target = images(20, 30, seed=6)
    assert value_and_gradient(rendering, target, L1)[1].is_contiguous()


def test_a_rendering_with_a_graph_is_taken_without_it():
    rendering, target = images(12, 12, seed=7)
    leaf = rendering.clone().requires_grad_()
    for drawn in (leaf * 1, leaf.double()):
        value, gradient = photometric_gradient(drawn.permute(1, 2, 0), Target(target), L1)
        assert not value.requires_grad
        assert not gradient.requires_grad
        with torch.no_grad():
            again = photometric_gradient(drawn.permute(1, 2, 0), Target(target), L1)
        assert torch.equal(again[1], gradient)


def test_not_a_number_is_not_hidden():
    rendering, target = images(30, 30, seed=8)
    rendering[1, 10, 10] = float("nan")
    value, gradient = value_and_gradient(rendering, target, L1)
    assert value.isnan()
    assert gradient[1, 10, 10].isnan()
    assert gradient[0].isfinite().all()


def test_double_precision_takes_the_torch_path():
    rendering, target = images(12, 15, seed=9)
    value, gradient = value_and_gradient(rendering.double(), target, L1)
    assert value.dtype == gradient.dtype == torch.float64
    assert value.item() == pytest.approx(photometric_reference(rendering.double(), target.double(), L1).item())
    torch.testing.assert_close(gradient.float(), value_and_gradient(rendering, target, L1)[1], rtol=0, atol=1e-6)


def test_sizes_that_differ_are_refused():
    rendering, _ = images(12, 15, seed=9)
    _, target = images(12, 16, seed=9)
    with pytest.raises(ValueError, match=r"\(12, 15\) and \(12, 16\)"):
        photometric_gradient(rendering.permute(1, 2, 0), Target(target), L1)


def test_ssim_lies_between_minus_one_and_one():
    rendering, target = images(25, 25, seed=10)
    values = ssim_map(rendering.clamp(0, 1).double(), target.double())
    assert values.max() <= 1
    assert values.min() >= -1
    assert torch.allclose(ssim_map(target.double(), target.double()), torch.ones((), dtype=torch.float64))
