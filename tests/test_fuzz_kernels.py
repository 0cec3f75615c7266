"""The other kernels at the edges of float32: finite in, finite out; NaN in, NaN out; no crash, no hang."""

from dataclasses import replace

import pytest
import torch
from hypothesis import given
from hypothesis import strategies as st
from torch import Tensor

from fuzz import assert_finite, fuzzed, numbers, tensors, watchdog  # noqa: F401
from ringlight.color.drawable import drawable, drawable_rows
from ringlight.color.harmonics import SphericalHarmonics
from ringlight.color.ringlight import RingLight
from ringlight.color.ringlight_settings import RingLightSettings
from ringlight.color.visibility_mask import mask_factor, mask_gradient
from ringlight.core.camera import Camera
from ringlight.core.gaussians import Gaussians
from ringlight.core.scene import PointCloud
from ringlight.core.want import Want
from ringlight.fit.adam import Update, adam_
from ringlight.fit.losses.photometric_gradient import Target, photometric_gradient
from ringlight.fit.photometric import PhotometricLoss
from ringlight.shade.reflection import ReflectionShader
from ringlight.shade.reflection_settings import ReflectionSettings
from torch_graph import channels, shaded

pytest.importorskip("ringlight._kernels", reason="needs the compiled module")

COUNTS = st.sampled_from([0, 1, 15, 16, 17, 70])
# A difference of two positions must be a number.
LARGEST_POSITION = 1e38
LARGEST_COEFFICIENT = 1e30
# SSIM multiplies four values of an image with each other, and its gradient divides by such products.
LARGEST_PIXEL = 1e4
NAN = float("nan")


def camera_at(z: float) -> Camera:
    pose = torch.eye(4)
    pose[2, 3] = z
    return Camera(pose, (60.0, 70.0), (30.0, 20.0), 64, 48)


def table(means: Tensor, **appearance: Tensor) -> Gaussians:
    count = len(means)
    return Gaussians(means, torch.zeros(count, 3), torch.ones(count, 4), torch.zeros(count), appearance)


@fuzzed
@given(data=st.data(), count=COUNTS, degree=st.integers(0, 3), z=st.sampled_from([0.0, 4.0, -1e30]))
def test_harmonics(data: st.DataObject, count: int, degree: int, z: float):
    means = data.draw(tensors(count, 3, largest=LARGEST_POSITION))
    constant = data.draw(tensors(count, 3, largest=LARGEST_COEFFICIENT))
    rest = data.draw(tensors(count, 15, 3, largest=LARGEST_COEFFICIENT))
    for leaf in (means, constant, rest):
        leaf.requires_grad_()
    rgb = channels(SphericalHarmonics(degree), table(means, sh_dc=constant, sh_rest=rest), camera_at(z))["rgb"]
    rgb.backward(torch.randn(count, 3))
    assert_finite(rgb=rgb, means=means.grad, constant=constant.grad, rest=rest.grad)


@fuzzed
@given(data=st.data(), count=st.integers(1, 40))
def test_a_nan_among_the_harmonics_stays_in_its_row(data: st.DataObject, count: int):
    row = data.draw(st.integers(0, count - 1))
    constant = torch.randn(count, 3)
    constant[row, 1] = NAN
    gaussians = table(torch.randn(count, 3), sh_dc=constant, sh_rest=torch.randn(count, 15, 3))
    rgb = SphericalHarmonics(3).emit(gaussians, camera_at(4), ("rgb",), Want.EXACT).channels
    others = torch.arange(count) != row
    assert rgb[row, 1].isnan(), "hidden where the rasterizer would have reported it"
    assert_finite(others=rgb[others])


@fuzzed
@given(data=st.data(), height=st.integers(1, 40), width=st.integers(1, 40), squared=st.booleans())
def test_loss(data: st.DataObject, height: int, width: int, squared: bool):
    image = data.draw(tensors(3, height, width, largest=LARGEST_PIXEL)).permute(1, 2, 0)
    target = Target(data.draw(tensors(3, height, width, largest=LARGEST_PIXEL)))
    value, gradient = photometric_gradient(image, target, PhotometricLoss(pixel="l2" if squared else "l1"))
    assert_finite(value=value, gradient=gradient)


@fuzzed
@given(data=st.data(), count=COUNTS, faint=st.booleans())
def test_rows_worth_a_color_are_rows_of_the_table(data: st.DataObject, count: int, faint: bool):
    """Numbers that are not finite among them: such rows must not be lost on the way to the rasterizer's report."""
    means, log_scales, logits = (data.draw(tensors(*shape)) for shape in ((count, 3), (count, 3), (count,)))
    if count and faint:
        means[data.draw(st.integers(0, count - 1))] = NAN
        logits[data.draw(st.integers(0, count - 1))] = -float("inf")
    gaussians = Gaussians(means, log_scales, torch.ones(count, 4), logits)
    rows = drawable_rows(gaussians, camera_at(4)).long()
    assert ((rows >= 0) & (rows < count)).all()
    assert (rows.diff() > 0).all()
    ordinary = (means.abs() < 1e3).all(1) & (log_scales.abs() < 10).all(1)
    marked = drawable(gaussians, camera_at(4))
    found = torch.zeros(count, dtype=torch.bool).index_fill_(0, rows, True)
    assert torch.equal(found[ordinary], marked[ordinary])


@fuzzed
@given(data=st.data(), count=COUNTS)
def test_visibility_mask(data: st.DataObject, count: int):
    logits = data.draw(tensors(count))
    factor = mask_factor(logits, 0.01)
    assert ((factor == 0) | (factor == 1)).all()
    assert_finite(gradient=mask_gradient(logits, torch.randn(count)))


def steps_of_adam(value: Tensor, gradients: list[Tensor]) -> tuple[Tensor, int]:
    mean, square, kept = torch.zeros_like(value), torch.zeros_like(value), 0
    for number, gradient in enumerate(gradients, 1):
        kept += adam_([Update(value, gradient, mean, square, (0.01, 0.9, 0.999, 1e-15, number))])
    assert_finite(mean=mean, square=square)
    return value, kept


@fuzzed
@given(data=st.data(), count=COUNTS)
def test_adam(data: st.DataObject, count: int):
    gradients = [data.draw(tensors(count, 3)) for _ in range(3)]
    assert_finite(value=steps_of_adam(data.draw(tensors(count, 3)), gradients)[0])


@fuzzed
@given(count=st.integers(1, 70), place=st.integers(0, 209), bad=st.sampled_from([NAN, float("inf")]))
def test_a_gradient_that_is_not_finite_leaves_its_own_element_alone(count: int, place: int, bad: float):
    gradient = torch.ones(count * 3)
    gradient[place % (3 * count)] = bad
    value, kept = steps_of_adam(torch.zeros(3 * count), [gradient])
    assert kept == 1
    assert (value == 0).nonzero()[:, 0].tolist() == [place % (3 * count)]


SHADER = ReflectionShader(ReflectionSettings(hidden=16, levels=(4, 9)), torch.tensor([[-1.0, -1, -1], [1, 1, 1]]))
# Vectors are squared, and their gradients divide by such squares.
LARGEST_BLENDED = 1e8


@fuzzed
@given(data=st.data(), height=st.integers(1, 20), width=st.integers(1, 40), z=st.sampled_from([0.0, 4.0, -1e4]))
def test_reflection_shader(data: st.DataObject, height: int, width: int, z: float):
    widths = {"rgb": 3, "normal": 3, "latents": 4, "depth": 1}
    planes = {name: data.draw(tensors(c, height, width, largest=LARGEST_BLENDED)) for name, c in widths.items()}
    planes["alpha"] = data.draw(tensors(1, height, width, largest=1.0)).clamp(0, 1)
    buffers = {name: plane.permute(1, 2, 0).requires_grad_() for name, plane in planes.items()}
    view = replace(camera_at(z), width=width, height=height)
    SHADER.zero_grad()
    color = shaded(SHADER, buffers, view, torch.ones(3))
    color.backward(torch.randn(color.shape))
    gradients = {name: leaf.grad for name, leaf in buffers.items() if name != "depth"}
    assert_finite(color=color, **gradients, **{n.replace(".", "_"): p.grad for n, p in SHADER.named_parameters()})


RING = RingLight(RingLightSettings(latents=2), torch.tensor([[-1.0, -1, -1], [1, 1, 1]]), seed=0)


@fuzzed
@given(data=st.data(), count=st.sampled_from([1, 15, 16, 17, 70]), z=st.sampled_from([0.0, 4.0, -1e30]))
def test_ring_field(data: st.DataObject, count: int, z: float):
    means = data.draw(tensors(count, 3))
    columns = RING.new_columns(PointCloud(means, torch.rand(count, 3)))
    leaves = {
        name: data.draw(tensors(*columns[name].shape, largest=1e3)).requires_grad_() for name in ("base", "latents")
    }
    RING.zero_grad()
    gaussians = table(means, **(columns | leaves))
    rgb = channels(RING, gaussians, camera_at(z))["rgb"]
    rgb.backward(torch.randn(count, 3))
    gradients = {name.replace(".", "_"): p.grad for name, p in RING.named_parameters() if p.grad is not None}
    assert_finite(rgb=rgb, **{name: leaf.grad for name, leaf in leaves.items()}, **gradients)
