"""Any finite table gives a finite image and finite gradients; nothing crashes, and nothing hangs."""

import pytest
import torch
from hypothesis import given
from hypothesis import strategies as st

from contracts.raster_cases import Case, run
from fuzz import assert_finite, fuzzed, numbers, tensors, watchdog  # noqa: F401
from ringlight.core.camera import Camera
from ringlight.core.gaussians import Gaussians
from ringlight.errors import BackendError
from ringlight.rasterize.contract import RasterOptions
from torch_graph import drawn

cpu = pytest.importorskip("ringlight.rasterize.cpu", reason="needs the compiled module")

# Colours and their gradients are sums over pixels: what the caller makes so large that sums of them overflow will.
LARGEST_CHANNEL = 1e15

# The gradient of a quaternion is that of a unit one over its length: of shorter ones it may lie beyond float32.
SHORTEST_QUATERNION = 1e-15


@st.composite
def tables(draw: st.DrawFn) -> Gaussians:
    """None, one or some Gaussians before the camera of :func:`cameras`, in part degenerate."""
    count = draw(st.sampled_from([0, 1, 2, 15, 16, 17, 40]))
    means = draw(tensors(count, 3))
    near = draw(st.sampled_from([None, 0.0, 0.01, 1e-6, -1e-6, -5.0, 1e30]))
    if near is not None and count:
        means[draw(st.integers(0, count - 1)), 2] = near - 4  # at, just before or behind the camera and its near plane
    log_scales = draw(tensors(count, 3)) - 1
    quats, logits = draw(tensors(count, 4)), draw(tensors(count))
    shape = draw(st.sampled_from(["as drawn", "needle", "disc", "point", "everything"]))
    if count and shape != "as drawn":
        row = draw(st.integers(0, count - 1))
        sizes = {"needle": [-80, -80, 3], "disc": [3, 3, -80], "point": [-200, -200, -200], "everything": [88, 88, 88]}
        log_scales[row] = torch.tensor(sizes[shape]).float()
        quats[row] = draw(st.sampled_from([0.0, 1e-38, 1e-30, 1.0, 1e30]))
    return Gaussians(means, log_scales, quats, logits)


@st.composite
def cameras(draw: st.DrawFn) -> Camera:
    """Four units before the origin, or in the middle of it all, looking along z; any size and lens."""
    pose = torch.eye(4)
    pose[2, 3] = draw(st.sampled_from([4.0, 4.0, 0.0, -1e6, 1e6]))
    width, height = draw(st.sampled_from([(1, 1), (37, 29), (64, 32), (8192, 1), (1, 8192), (33, 97)]))
    focal = draw(st.sampled_from([1e-3, 1.0, 40.0, 1e5]))
    center = draw(st.sampled_from([0.5, -1.0, 3.0]))
    return Camera(pose, (focal, 1.1 * focal), (center * width, center * height), width, height)


@st.composite
def cases(draw: st.DrawFn) -> Case:
    table, camera = draw(tables()), draw(cameras())
    channels = draw(st.sampled_from([1, 2, 3, 4, 5, 8, 16, 20]))
    options = RasterOptions(
        eps2d=draw(st.sampled_from([0.0, 0.3, 1e4])), near=draw(st.sampled_from([0.0, 0.01, 3.0])),
        max_alpha=draw(st.sampled_from([1e-6, 0.99, 0.999, 0.9999999])), antialiased=draw(st.booleans()),
        absgrad=draw(st.booleans()),
    )  # fmt: skip
    factor = draw(tensors(len(table))) if draw(st.booleans()) else None
    colors = draw(tensors(len(table), channels, largest=LARGEST_CHANNEL))
    return Case(table, colors, camera, draw(tensors(channels, largest=LARGEST_CHANNEL)), options, factor)


@fuzzed
@given(case=cases(), seed=st.integers(0, 2**31))
def test_finite_input_gives_finite_output(case: Case, seed: int):
    generator = torch.Generator().manual_seed(seed)
    size = case.camera.height, case.camera.width
    grad_image = torch.randn(*size, case.channels.shape[1], generator=generator)
    outcome = run(cpu.CpuRasterizer(), case, grad_image, torch.randn(*size, 1, generator=generator))
    raster, footprint = outcome.raster, outcome.raster.footprint
    assert_finite(image=raster.image, alpha=raster.alpha, means2d=footprint.means2d, radii=footprint.radii)
    assert ((raster.alpha >= 0) & (raster.alpha <= 1)).all()
    short = (case.gaussians.quats.abs().amax(-1, keepdim=True) < SHORTEST_QUATERNION).expand(-1, 4)
    grad_quats = outcome.gradients["quats"]
    assert not grad_quats.isnan().any()
    gradients = {**outcome.gradients, "quats": grad_quats.masked_fill(short, 0)}
    assert_finite(**gradients, means2d_gradient=footprint.means2d_gradient)
    if case.options.absgrad:
        assert_finite(absolute=footprint.absolute_gradient)


@fuzzed
@given(case=cases(), bad=st.sampled_from([float("nan"), float("inf"), -float("inf")]), place=st.integers(0, 2**31))
def test_one_number_that_is_not_finite_is_found_wherever_it_is(case: Case, bad: float, place: int):
    columns = {**case.gaussians.columns(), "channels": case.channels, "opacity_factor": case.opacity_factor}
    names = [name for name, column in columns.items() if column is not None and column.numel()]
    if not names:
        return
    name = names[place % len(names)]
    index = place // len(names) % columns[name].numel()
    columns[name].view(-1)[index] = bad
    row = index // (columns[name].numel() // len(case.channels))
    with pytest.raises(BackendError, match=rf"column {name} holds {bad} in row {row}: "):
        drawn(
            cpu.CpuRasterizer(), case.gaussians, case.channels, case.camera, case.background, case.options,
            case.opacity_factor,
        )  # fmt: skip
