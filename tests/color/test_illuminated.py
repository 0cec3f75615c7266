"""The colour model of 3iGS: its kernels against the reference, in value and gradient."""

import pytest
import torch

from contracts.plugged import BOX, ILLUMINATION
from ringlight import _kernels
from ringlight.color.illuminated import FEATURES, ROUGHNESS, Illuminated
from ringlight.color.illumination_settings import IlluminationSettings
from ringlight.core.camera import Camera
from ringlight.core.gaussians import Gaussians
from ringlight.core.gradients import Gradients, dense
from ringlight.core.scene import PointCloud
from ringlight.core.want import Want
from tiny_scene import tiny_scene

BF16 = _kernels.isa() in ("avx512_bf16", "avx512_amx")
TOLERANCE = 0.15 if BF16 else 1e-3
"""Of a gradient's length; bfloat16 has eight bits, and hidden units near their kinks fall to either side."""
NEAR = 0.02 if BF16 else 1e-5
"""Of a colour."""


def table(model: Illuminated, count: int = 300) -> Gaussians:
    generator = torch.Generator().manual_seed(3)
    low, high = BOX
    means = low + (high - low) * torch.rand(count, 3, generator=generator)
    columns = model.new_columns(PointCloud(means, torch.rand(count, 3, generator=generator)))
    columns[FEATURES] = 0.5 * torch.randn(columns[FEATURES].shape, generator=generator)
    return Gaussians(means, torch.full((count, 3), -3.0), torch.randn(count, 4), torch.zeros(count), columns)


@pytest.fixture
def camera() -> Camera:
    return tiny_scene().train[0].camera


def emitted(
    model: Illuminated, gaussians: Gaussians, camera: Camera, positive: bool = False
) -> tuple[torch.Tensor, Gradients]:
    emission, into = model.emit(gaussians, camera, ["rgb"], Want.GRADIENTS), Gradients()
    upstream = torch.randn(emission.channels.shape, generator=torch.Generator().manual_seed(4))
    emission.backward((upstream.abs() if positive else upstream).to(emission.channels), None, into)
    return emission.channels, into


@pytest.mark.parametrize("lit", [True, False])
def test_kernels_equal_the_reference(camera: Camera, lit: bool):
    model = Illuminated(ILLUMINATION, BOX, 1)
    model.lit.fill_(lit)
    with torch.no_grad():
        for grids in (model.field.planes, model.field.lines):
            grids.mul_(50)
    gaussians = table(model)
    colors, gradients = emitted(model, gaussians, camera)
    exact = Gaussians.from_columns({name: column.double() for name, column in gaussians.columns().items()})
    expected, judges = emitted(model.double(), exact, camera)
    torch.testing.assert_close(colors.double(), expected, rtol=0, atol=NEAR)
    assert set(gradients) == set(judges)
    assert len(gradients) == (1 + 2 + 4 + 6 if lit else 1)
    for name, judge in judges.items():
        off = (dense(gradients[name]).double() - dense(judge)).norm()
        assert off <= TOLERANCE * dense(judge).norm(), name


@pytest.mark.parametrize(
    ("count", "components", "features", "hidden", "share"),
    [(1, 1, 3, 1, 1.0), (33, 16, 16, 12, 0.5), (70, 18, 5, 37, 0.5)],
)
def test_kernels_equal_the_reference_for_any_widths(
    camera: Camera, count: int, components: int, features: int, hidden: int, share: float
):
    """Lanes and blocks that are not full; and a share draws the rows that the reference draws."""
    settings = IlluminationSettings(side=7, components=components, features=features, hidden=hidden)
    model = Illuminated(settings, BOX, 1, gradient_share=share)
    with torch.no_grad():
        for grids in (model.field.planes, model.field.lines):
            grids.mul_(50)
    gaussians = table(model, count)
    colors, gradients = emitted(model, gaussians, camera)
    exact = Gaussians.from_columns({name: column.double() for name, column in gaussians.columns().items()})
    expected, judges = emitted(model.double(), exact, camera)
    torch.testing.assert_close(colors.double(), expected, rtol=0, atol=NEAR)
    assert set(gradients) == set(judges)
    for name, judge in judges.items():
        off = (dense(gradients[name]).double() - dense(judge)).norm()
        assert off <= TOLERANCE * dense(judge).norm(), name


def test_rows_that_nobody_sees_get_no_gradient(camera: Camera):
    model = Illuminated(ILLUMINATION, BOX, 1)
    gaussians = table(model, 40)
    emission, into = model.emit(gaussians, camera, ["rgb"], Want.GRADIENTS), Gradients()
    upstream = torch.zeros_like(emission.channels)
    emission.backward(upstream, None, into)
    assert set(into) == {"columns.base"}
    upstream[7], into = 1.0, Gradients()
    emission.backward(upstream, None, into)
    for name in (FEATURES, ROUGHNESS):
        assert dense(into["columns." + name]).reshape(40, -1).ne(0).any(-1).nonzero().flatten().tolist() == [7]


def test_the_same_bits_for_any_number_of_threads(camera: Camera):
    model = Illuminated(ILLUMINATION, BOX, 1)
    gaussians, before = table(model, 3000), _kernels.threads()
    try:
        results = []
        for threads in (1, 2, 4):
            _kernels.set_threads(threads)
            results.append(emitted(model, gaussians, camera))
    finally:
        _kernels.set_threads(before)
    for colors, gradients in results[1:]:
        assert torch.equal(colors, results[0][0])
        assert all(torch.equal(dense(gradients[name]), dense(first)) for name, first in results[0][1].items())


def test_a_share_of_the_gradients_is_right_in_expectation(camera: Camera):
    whole, share = (Illuminated(ILLUMINATION, BOX, 1, gradient_share=share) for share in (1.0, 0.5))
    gaussians = table(whole, 3000)
    (colors, of_all), (same, of_share) = (emitted(model, gaussians, camera, positive=True) for model in (whole, share))
    assert torch.equal(colors, same)
    rows_of = [int((dense(found["columns." + ROUGHNESS]) != 0).sum()) for found in (of_all, of_share)]
    assert 0.3 * rows_of[0] < rows_of[1] < 0.7 * rows_of[0]
    first, other = (dense(found["color.network.biases.2"]) for found in (of_all, of_share))
    assert (first - other).norm() < 0.3 * first.norm()


def test_new_rows_begin_with_the_points_colours(camera: Camera):
    model = Illuminated(ILLUMINATION, BOX, 1)
    model.lit.fill_(False)
    colors = torch.rand(20, 3, generator=torch.Generator().manual_seed(0))
    gaussians = table(model, 20)
    columns = model.new_columns(PointCloud(gaussians.means, colors))
    assert torch.equal(columns[ROUGHNESS], model.new_columns(PointCloud(gaussians.means, colors))[ROUGHNESS])
    shown = model.emit(
        Gaussians(gaussians.means, gaussians.log_scales, gaussians.quats, gaussians.opacity_logits, columns),
        camera,
        ["rgb"],
        Want.EXACT,
    ).channels
    torch.testing.assert_close(shown, colors.clamp(0.25 / 255, 1 - 0.25 / 255))
