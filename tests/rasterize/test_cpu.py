"""What only the CPU back end promises; the contract itself is in tests/contracts/test_rasterizers.py."""

import gc
import subprocess
import sys
from dataclasses import replace

import pytest
import torch
from torch import Tensor

from contracts.raster_cases import Case, judge, random_case, random_cotangents, run
from raster_oracle import ORACLES, load_oracle
from ringlight.core.camera import Camera
from ringlight.core.gaussians import Gaussians
from ringlight.core.gradients import Gradients
from ringlight.core.rendering import Emission, Raster
from ringlight.core.want import Want
from ringlight.errors import BackendError
from torch_graph import drawn

pytestmark = pytest.mark.usefixtures("all_cores_afterwards")

_kernels = pytest.importorskip("ringlight._kernels", reason="needs the compiled module")
cpu = pytest.importorskip("ringlight.rasterize.cpu", reason="needs the compiled module")


@pytest.fixture
def rasterizer() -> "cpu.CpuRasterizer":
    return cpu.CpuRasterizer()


def crowd(seed: int, count: int = 3000, channels: int = 3, size: tuple[int, int] = (150, 110)) -> Case:
    """Enough Gaussians for several chunks per tile and several pieces of the table, a few of them image-wide."""
    case = random_case(seed, count, channels, size, with_factor=True)
    case.gaussians.log_scales[::50] += 2.5
    return case


def all_bits(rasterizer: "cpu.CpuRasterizer", case: Case, threads: int) -> list[Tensor]:
    _kernels.set_threads(threads)
    generator = torch.Generator().manual_seed(0)
    shape = case.camera.height, case.camera.width
    grad_image = torch.randn(*shape, case.channels.shape[1], generator=generator)
    outcome = run(rasterizer, case, grad_image, torch.randn(*shape, 1, generator=generator))
    footprint = outcome.raster.footprint
    marks = [footprint.means2d, footprint.radii, footprint.means2d_gradient, footprint.absolute_gradient]
    return [outcome.raster.image, outcome.raster.alpha, *marks, *outcome.gradients.values()]


@pytest.mark.parametrize("channels", [3, 8, 16, 40])
def test_any_number_of_threads_gives_the_same_bits(rasterizer, channels: int):
    case = crowd(channels, channels=channels)
    alone = all_bits(rasterizer, case, 1)
    for threads in (2, 4):
        for ours, theirs in zip(alone, all_bits(rasterizer, case, threads), strict=True):
            assert torch.equal(ours, theirs)


# An alpha that lies on 1/255 up to rounding is drawn or not: up to 1/255 of a channel, at single pixels.
ORACLE_IMAGE_TOLERANCE = 2e-4
# Of the largest gradient of the column; the oracle's own float32 run is off by as much.
ORACLE_GRADIENT_TOLERANCE = 1.5e-4


def off_by(found: Tensor, expected: Tensor) -> float:
    """Largest difference as a share of the largest expected value."""
    return ((found.double() - expected).abs().max() / expected.abs().max()).item()


@pytest.mark.parametrize("name", ORACLES)
def test_equals_the_oracle(rasterizer, name: str):
    oracle = load_oracle(name, torch.float32)
    arrays = oracle.arrays
    raster = drawn(rasterizer, oracle.gaussians, oracle.channels, oracle.camera, oracle.background, oracle.options)
    torch.autograd.backward([raster.image, raster.alpha], oracle.cotangents)

    assert (raster.image.detach() - arrays["img"]).abs().max() < ORACLE_IMAGE_TOLERANCE
    assert (raster.alpha.detach()[..., 0] - arrays["alpha"]).abs().max() < ORACLE_IMAGE_TOLERANCE
    for column in ("means", "scales", "quats", "opacities", "colors"):  # torch differentiates logit and log
        assert off_by(oracle.leaves[column].grad, arrays[f"g_{column}"]) < ORACLE_GRADIENT_TOLERANCE, column
    footprint, seen = raster.footprint, raster.footprint.visible
    assert torch.equal(footprint.radii, arrays["radii"].float())
    assert off_by(footprint.means2d[seen], arrays["means2d"][seen]) < 1e-6
    assert off_by(footprint.means2d_gradient, arrays["g_means2d"]) < ORACLE_GRADIENT_TOLERANCE
    assert off_by(footprint.absolute_gradient, arrays["absgrad_means2d"]) < ORACLE_GRADIENT_TOLERANCE


@pytest.mark.parametrize("size", [(8192, 3), (3, 8192), (4097, 40)])
def test_large_images_have_their_last_tile(rasterizer, size: tuple[int, int]):
    case = random_case(3, count=12, size=size)
    cotangents = random_cotangents(case, 0)
    found, expected = run(rasterizer, case, *cotangents), judge(case, *cotangents)
    # Pixel coordinates in the thousands leave float32 four digits behind the point.
    difference = (found.raster.image.double() - expected.raster.image).abs()
    assert difference.mean() < 1e-4
    assert found.raster.image[-1, -1].isfinite().all()
    assert (found.raster.footprint.radii > 0).any()


def test_larger_images_are_refused_with_the_limit(rasterizer):
    with pytest.raises(BackendError, match="8192"):
        run(rasterizer, random_case(0, size=(8193, 2)), torch.zeros(2, 8193, 3), torch.zeros(2, 8193, 1))


def test_more_entries_than_can_be_counted_are_refused(rasterizer):
    """Seventy thousand Gaussians that each cover 65,536 tiles: refused before the memory is asked for."""
    count = 70_000
    means = torch.tensor([0.0, 0, 1]).repeat(count, 1)
    table = Gaussians(means, torch.full((count, 3), 3.0), torch.ones(count, 4), torch.zeros(count))
    camera = Camera(torch.eye(4), (8192.0, 8192.0), (4096.0, 4096.0), 8192, 8192)
    with pytest.raises(BackendError, match="more memory"):
        drawn(rasterizer, table, torch.ones(count, 1), camera, torch.zeros(1))


def test_a_render_bomb_is_refused_at_once(rasterizer):
    """Gaussians that cover everything and hide nothing: no tile could stop early."""
    count = 3_000
    means = torch.tensor([0.0, 0, 1]).repeat(count, 1)
    table = Gaussians(means, torch.full((count, 3), 3.0), torch.ones(count, 4), torch.full((count,), -5.0))
    camera = Camera(torch.eye(4), (8192.0, 8192.0), (4096.0, 4096.0), 8192, 8192)
    with pytest.raises(BackendError, match="more time, than a view may take"):
        drawn(rasterizer, table, torch.ones(count, 1), camera, torch.zeros(1))


def test_other_types_are_refused_with_the_remedy(rasterizer):
    case = random_case(0).to(torch.float64)
    with pytest.raises(BackendError, match="float32"):
        raster_of(rasterizer, case)


def ways_back(rasterizer: "cpu.CpuRasterizer", cases: list[Case]) -> list[Tensor]:
    """Draws all cases first and goes their ways back afterwards, last one first; gradients of the means."""
    rasters = [raster_of(rasterizer, case) for case in cases]
    found = [means_gradient(raster) for raster in reversed(rasters)]
    return found[::-1]


def raster_of(rasterizer: "cpu.CpuRasterizer", case: Case, want: Want = Want.GRADIENTS) -> Raster:
    emission = Emission({"channels": case.channels.shape[1]}, case.channels)
    return rasterizer.draw(case.gaussians, emission, case.camera, case.background, want=want)


def means_gradient(raster: Raster) -> Tensor:
    """Of the image's sum of squares."""
    into = Gradients()
    raster.backward(2 * raster.image, None, into)
    return into["columns.means"]


def test_records_may_overlap(rasterizer):
    cases = [random_case(seed, size=(40 + seed, 30)) for seed in range(3)]
    together = ways_back(rasterizer, cases)
    for case, gradient in zip(cases, together, strict=True):
        assert torch.equal(ways_back(rasterizer, [case])[0], gradient)


def test_the_way_back_is_gone_once_whatever_is_drawn_in_between(rasterizer):
    case, other = random_case(1), random_case(2, size=(90, 70))
    (expected,) = ways_back(rasterizer, [case])
    raster = raster_of(rasterizer, case)
    ways_back(rasterizer, [other])
    for want in (Want.EXACT, Want.PICTURE):
        raster_of(rasterizer, other, want)
    assert torch.equal(means_gradient(raster), expected)
    with pytest.raises(RuntimeError, match="gone already; draw it again"):
        means_gradient(raster)


@pytest.mark.parametrize("want", [Want.EXACT, Want.PICTURE])
def test_only_who_asked_for_gradients_finds_a_way_back(rasterizer, want: Want):
    with pytest.raises(RuntimeError, match=r"ask for it with Want\.GRADIENTS"):
        means_gradient(raster_of(rasterizer, random_case(1), want))


def test_workspaces_are_used_again(rasterizer):
    case = random_case(1)
    for _ in range(4):
        ways_back(rasterizer, [case])
        raster_of(rasterizer, case, Want.EXACT)
        assert len(rasterizer.spare) == 1
    raster_of(rasterizer, case)  # whose way back nobody goes
    gc.collect()
    assert len(rasterizer.spare) == 1


def test_the_memory_order_of_the_upstream_gradient_does_not_matter(rasterizer):
    case = random_case(4)
    grad_image, grad_alpha = random_cotangents(case, 0)
    planar = grad_image.permute(2, 0, 1).contiguous().permute(1, 2, 0)
    ours, theirs = run(rasterizer, case, grad_image, grad_alpha), run(rasterizer, case, planar, grad_alpha)
    assert all(torch.equal(ours.gradients[name], theirs.gradients[name]) for name in ours.gradients)
    assert ours.raster.image.permute(2, 0, 1).is_contiguous()


@pytest.mark.parametrize("with_gradient", [0, 1, 4, 5, 6, 10, 11, 12])
def test_last_channels_without_gradient_are_left_out_and_nothing_else_changes(rasterizer, with_gradient: int):
    case = random_case(6, channels=13)
    grad_image, grad_alpha = random_cotangents(case, 0)
    grad_image[..., with_gradient:] = 0
    found, expected = run(rasterizer, case, grad_image, grad_alpha), judge(case, grad_image, grad_alpha)
    assert not found.gradients["channels"][:, with_gradient:].any()
    for name in expected.gradients.keys() - ({"channels"} if with_gradient == 0 else set()):
        assert off_by(found.gradients[name], expected.gradients[name]) < 1e-4, name


def test_columns_whose_memory_holds_the_negatives_are_drawn_as_they_are_meant(rasterizer):
    case = random_case(6)
    draw = lambda channels: raster_of(rasterizer, replace(case, channels=channels)).image  # noqa: E731
    assert torch.equal(draw(torch._neg_view(-case.channels)), draw(case.channels))


OTHER_MEMORY = """
import torch
from ringlight.bench.workload import Size, workload
from ringlight.core.gaussians import GEOMETRY, Gaussians
from ringlight.core.gradients import Gradients
from ringlight.core.rendering import Emission
from ringlight.core.want import Want
from ringlight.rasterize.cpu import CpuRasterizer

work = workload(Size(200_000, 64))  # arrays so large that the system takes freed ones back at once

def gradients(between):
    columns = {name: getattr(work.gaussians, name).clone() for name in GEOMETRY}
    channels = work.channels.clone()
    emission = Emission({"channels": channels.shape[1]}, channels)
    table, behind = Gaussians.from_columns(columns), torch.ones(3)
    raster = CpuRasterizer().draw(table, emission, work.camera, behind, want=Want.GRADIENTS)
    for column in (*columns.values(), channels):
        between(column)
    into = Gradients()
    into["channels"], _ = raster.backward(torch.ones_like(raster.image), None, into)
    return into

def elsewhere(column):
    column.data = column.data.clone()

found, expected = gradients(elsewhere), gradients(lambda column: None)
assert len(found) == 5
assert all(torch.equal(found[name], expected[name]) for name in expected)
"""


def test_columns_whose_memory_was_exchanged_before_backward_are_read_where_they_are():
    """In a process of its own: to read what was freed ends it."""
    done = subprocess.run([sys.executable, "-c", OTHER_MEMORY], check=False, capture_output=True, text=True)
    assert done.returncode == 0, f"{done.returncode}: {done.stderr}"
