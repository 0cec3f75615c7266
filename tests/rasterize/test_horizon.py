"""What a view hid the last time changes no bit of its picture and gradients, however wrong it has become since."""

import math
from dataclasses import replace

import pytest
import torch
from hypothesis import given
from hypothesis import strategies as st
from torch import Tensor

from contracts.raster_cases import Case, random_case, run
from fuzz import fuzzed, watchdog  # noqa: F401
from ringlight.core.gaussians import Gaussians
from ringlight.rasterize import convention
from ringlight.rasterize.contract import RasterOptions
from ringlight.rasterize.horizon import Horizon
from ringlight.rasterize.projection import project
from ringlight.rasterize.reference import pair_alphas

_kernels = pytest.importorskip("ringlight._kernels", reason="needs the compiled module")
cpu = pytest.importorskip("ringlight.rasterize.cpu", reason="needs the compiled module")

MARGIN = 1.05
"""By which the kernels push a horizon back."""


def opaque(seed: int, channels: int = 3, size: tuple[int, int] = (96, 72), count: int = 3000) -> Case:
    """So many Gaussians that most tiles become opaque, some of them image-wide; a few tiles stay open."""
    case = random_case(seed, count, channels, size)
    case.gaussians.log_scales[::50] += 2.5
    case.gaussians.opacity_logits[:] += 2
    return case


def with_horizon(case: Case, horizon: Horizon | None) -> Case:
    return replace(case, options=replace(case.options, horizon=horizon))


def bits(rasterizer: "cpu.CpuRasterizer", case: Case) -> dict[str, Tensor]:
    """All that a forward and a backward pass give."""
    generator = torch.Generator().manual_seed(0)
    shape = case.camera.height, case.camera.width
    by_image = torch.randn(*shape, case.channels.shape[1], generator=generator)
    outcome = run(rasterizer, case, by_image, torch.randn(*shape, 1, generator=generator))
    footprint = outcome.raster.footprint
    marks = {"means2d": footprint.means2d, "radii": footprint.radii, "by_center": footprint.means2d_gradient}
    if footprint.absolute_gradient is not None:
        marks["absolute"] = footprint.absolute_gradient
    return {"image": outcome.raster.image, "alpha": outcome.raster.alpha, **marks, **outcome.gradients}


def assert_same(found: dict[str, Tensor], expected: dict[str, Tensor]) -> None:
    assert found.keys() == expected.keys()
    for name in expected:
        assert torch.equal(found[name], expected[name]), name


def beyond(rasterizer: "cpu.CpuRasterizer") -> tuple[int, int]:
    """Gaussians hidden and tiles drawn again by the last pass of a rasterizer that has one workspace."""
    [workspace] = rasterizer._spare
    return workspace.beyond_horizon


@pytest.mark.parametrize("options", [RasterOptions(), RasterOptions(antialiased=True, absgrad=True)])
@pytest.mark.parametrize("channels", [1, 3, 4, 8, 16])
def test_later_pictures_of_a_view_are_the_first_bit_for_bit(channels: int, options: RasterOptions):
    rasterizer, horizon = cpu.CpuRasterizer(), Horizon()
    case = replace(opaque(channels, channels), options=options)
    expected = bits(rasterizer, case)
    for _ in range(3):
        assert_same(bits(rasterizer, with_horizon(case, horizon)), expected)
    hidden, again = beyond(rasterizer)
    assert hidden > 100
    assert again == 0


def test_any_number_of_threads_gives_the_same_bits_and_the_same_horizon():
    case, known = opaque(1), Horizon()
    expected = bits(cpu.CpuRasterizer(), with_horizon(case, known))
    try:
        for threads in (1, 2, 4):
            _kernels.set_threads(threads)
            horizon = Horizon()
            for _ in range(2):
                assert_same(bits(cpu.CpuRasterizer(), with_horizon(case, horizon)), expected)
            assert torch.equal(horizon.depths, known.depths)
    finally:
        _kernels.set_threads(0)


def saturation_depths(case: Case, least: float) -> Tensor:
    """The slow twin: camera z at which the last pixel of each tile goes down to ``least``, infinity where one does not.

    Whole blocks of 4 x 4 pixels, as the kernels: those at the border must lie in the image.
    """
    case, camera = case.to(torch.float64), case.camera
    splats = project(case.gaussians, camera, case.options)
    rows = splats.on_image(camera, case.options.near).nonzero()[:, 0]
    splats = splats.rows(rows[splats.depths[rows].argsort(stable=True)])
    y, x = torch.meshgrid(torch.arange(camera.height) + 0.5, torch.arange(camera.width) + 0.5, indexing="ij")
    pixels = torch.stack([x, y], -1).reshape(-1, 2).double()
    centers = splats.means2d.expand(len(pixels), -1, -1)
    transmittances = (1 - pair_alphas(splats, centers, pixels, case.options.max_alpha)).cumprod(1)
    depths = torch.cat([splats.depths, torch.tensor([math.inf]).double()])
    closing = depths[(transmittances > least).sum(1)].reshape(camera.height, camera.width)
    tiles = [row.split(convention.TILE, 1) for row in closing.split(convention.TILE)]
    return torch.stack([torch.stack([tile.max() for tile in row]) for row in tiles])


@pytest.mark.parametrize("seed", range(4))
def test_the_depths_are_those_of_the_slow_twin(seed: int):
    """Up to rounding: they lie between those of slightly different thresholds."""
    case, horizon = opaque(seed, size=(96, 76), count=700), Horizon()
    cpu.CpuRasterizer()(case.gaussians, case.channels, case.camera, case.background, RasterOptions(horizon=horizon))
    doubt = 0.01
    early, late = (saturation_depths(case, convention.MIN_TRANSMITTANCE * k) for k in (1 + doubt, 1 - doubt))
    found = horizon.depths.double() / MARGIN
    assert found.shape == early.shape == (3, 3)
    assert (found >= early * (1 - 1e-5)).all()
    assert (found <= late * (1 + 1e-5)).all()
    assert found.isfinite().any()


def test_a_tile_that_is_no_longer_opaque_before_its_horizon_is_drawn_again():
    rasterizer, horizon, case = cpu.CpuRasterizer(), Horizon(), opaque(2)
    bits(rasterizer, with_horizon(case, horizon))
    faint = replace(case, gaussians=replace(case.gaussians, opacity_logits=case.gaussians.opacity_logits - 3))
    closed = int(horizon.depths.isfinite().sum())
    assert_same(bits(rasterizer, with_horizon(faint, horizon)), bits(cpu.CpuRasterizer(), faint))
    _, again = beyond(rasterizer)
    assert 0 < again <= closed
    assert_same(bits(rasterizer, with_horizon(faint, horizon)), bits(cpu.CpuRasterizer(), faint))
    assert beyond(rasterizer)[1] == 0


def moved(case: Case, seed: int, by: float, keep: int) -> Case:
    """The first rows of the same table, each a little or far away from where it was."""
    generator = torch.Generator().manual_seed(seed)
    columns = {name: column[:keep].clone() for name, column in case.gaussians.columns().items()}
    for column in columns.values():
        column += by * torch.randn(column.shape, generator=generator)
    return replace(case, gaussians=Gaussians.from_columns(columns), channels=case.channels[:keep])


@fuzzed
@given(
    seed=st.integers(0, 2**31),
    count=st.sampled_from([1, 40, 400, 1500]),
    by=st.sampled_from([0.0, 1e-3, 0.03, 0.3, 3.0]),
    keep=st.sampled_from([0.0, 0.5, 1.0]),
    channels=st.sampled_from([1, 3, 5, 20]),
    size=st.sampled_from([(96, 64), (37, 29), (65, 131)]),
)
def test_moving_gaussians_leave_the_bits_alone(
    seed: int, count: int, by: float, keep: float, channels: int, size: tuple[int, int]
):
    rasterizer, horizon = cpu.CpuRasterizer(), Horizon()
    before = opaque(seed, channels, size, count)
    after = moved(before, seed, by, int(count * keep))
    for case in (before, after, before):
        assert_same(bits(rasterizer, with_horizon(case, horizon)), bits(cpu.CpuRasterizer(), case))


DEPTHS = [math.nan, math.inf, -math.inf, -1.0, -0.0, 0.0, 1e-45, 1e-20, 0.5, 1.0, 2.0, 3.0, 4.0, 5.0, 3e38]


@fuzzed
@given(seed=st.integers(0, 2**31), depths=st.lists(st.sampled_from(DEPTHS), min_size=9, max_size=9))
def test_any_depths_leave_the_bits_alone(seed: int, depths: list[float]):
    case, horizon = opaque(seed, size=(96, 72), count=1000), Horizon()
    horizon.depths = torch.tensor(depths).reshape(3, 3)
    assert_same(bits(cpu.CpuRasterizer(), with_horizon(case, horizon)), bits(cpu.CpuRasterizer(), case))
    assert (horizon.depths > 0).all()


def test_a_retained_graph_gives_the_same_gradient_though_the_horizon_has_been_renewed():
    rasterizer, horizon, case = cpu.CpuRasterizer(), Horizon(), opaque(3)
    means = case.gaussians.means.clone().requires_grad_()
    table, options = replace(case.gaussians, means=means), RasterOptions(horizon=horizon)
    loss = rasterizer(table, case.channels, case.camera, case.background, options).image.square().sum()
    (first,) = torch.autograd.grad(loss, means, retain_graph=True)
    bits(rasterizer, with_horizon(opaque(4), horizon))
    (second,) = torch.autograd.grad(loss, means)
    assert torch.equal(first, second)


def test_pairs_are_counted_with_those_of_tiles_that_were_drawn_again():
    case = opaque(5)

    def counted(horizon: Tensor | None) -> tuple[int, int]:
        workspace, camera = _kernels.Workspace(), case.camera
        table = _kernels.SplatTable(
            *(getattr(case.gaussians, name) for name in ("means", "log_scales", "quats", "opacity_logits")),
            None, case.channels, case.background,
        )  # fmt: skip
        pinhole = _kernels.Pinhole(camera.world_to_camera, camera.focal, camera.center, camera.width, camera.height)
        arrays = [torch.empty(3, camera.height, camera.width), torch.empty(camera.height, camera.width)]
        arrays += [torch.empty(len(case.channels), 2), torch.empty(len(case.channels), 2)]
        workspace.forward(table, pinhole, _kernels.RasterSettings(0.3, 0.01, 0.999, False, False), *arrays, horizon)
        return workspace.count_pairs()

    assert counted(torch.full((3, 3), 1.0)) == counted(torch.full((3, 3), math.inf)) == counted(None)


def test_the_depths_begin_anew_where_the_image_has_another_number_of_tiles():
    horizon = Horizon()
    first = horizon.sized(33, 32)
    assert first.shape == (1, 2)
    assert first.isinf().all()
    first[:] = 3.0
    assert horizon.sized(64, 30) is first
    assert horizon.sized(65, 30).isinf().all()


def test_another_number_of_depths_than_tiles_is_refused():
    case, horizon = opaque(0, count=20), Horizon()
    horizon.sized = lambda width, height: torch.zeros(2, 3)
    with pytest.raises(ValueError, match="one depth per tile"):
        run(cpu.CpuRasterizer(), with_horizon(case, horizon), torch.zeros(72, 96, 3), torch.zeros(72, 96, 1))
