"""What every rasterizer must do, parametrised over all of them; the float64 reference judges."""

from dataclasses import replace

import pytest
import torch
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from torch import Tensor

from contracts.raster_cases import Case, Outcome, certain_pixels, judge, random_case, random_cotangents, run
from gsplat_torch import torch_gsplat_rasterizer
from on_gpu import RasterizerOnGpu
from raster_oracle import ORACLES, load_oracle
from ringlight.core.camera import Camera
from ringlight.core.gaussians import Gaussians
from ringlight.core.rendering import Emission
from ringlight.core.want import Want
from ringlight.errors import BackendError
from ringlight.rasterize.choose import rasterizer_for
from ringlight.rasterize.contract import Rasterizer, RasterOptions
from torch_graph import drawn

# Float32 rounds at 6e-8; an alpha passes through a projection of some twenty steps and an exponential (polynomial in
# kernels, 3e-6), a pixel blends up to eighty of them.
IMAGE_TOLERANCE = 2e-5
# Of the largest gradient in the column. Thin Gaussians lose digits in the conic, which its gradient divides by.
GRADIENT_TOLERANCE = 1e-4


@pytest.fixture(
    params=[
        pytest.param("reference", marks=pytest.mark.no_kernel),
        "cpu",
        pytest.param("gsplat-torch", marks=pytest.mark.no_kernel),
        pytest.param("cuda", marks=[pytest.mark.no_kernel, pytest.mark.cuda]),
    ]
)
def rasterizer(request: pytest.FixtureRequest) -> Rasterizer:
    if request.param == "cpu":
        pytest.importorskip("ringlight._kernels", reason="needs the compiled module")
        pytest.importorskip("ringlight.rasterize.cpu", reason="needs the CPU back end")
    if request.param == "gsplat-torch":  # the CUDA back end's own code, around gsplat's functions in torch
        return torch_gsplat_rasterizer()
    return RasterizerOnGpu() if request.param == "cuda" else rasterizer_for(request.param)


def skip_unless_compiled_in(rasterizer: Rasterizer, max_alpha: float):
    """gsplat's clamp is a constant of its kernels: what it cannot obey it must refuse."""
    if rasterizer.name == "cuda" and max_alpha != rasterizer.gsplat.numbers.max_alpha:
        case = replace(random_case(5), options=RasterOptions(max_alpha=max_alpha))
        with pytest.raises(BackendError, match="compiled into it"):
            run(rasterizer, case, *random_cotangents(case, 0))
        pytest.skip("another clamp is compiled into this gsplat")


def skip_where_sums_have_no_order(rasterizer: Rasterizer):
    if rasterizer.name == "cuda":
        pytest.skip("gsplat adds gradients up in any order")


def assert_close(found: Tensor, expected: Tensor, tolerance: float, what: str):
    """Largest difference as a share of the largest expected value."""
    assert found.shape == expected.shape, what
    assert found.isfinite().all(), f"{what} is not finite"
    scale = max(expected.abs().max().item(), 1e-6) if expected.numel() else 1.0
    error = (found.double() - expected).abs().max().item() / scale if expected.numel() else 0.0
    assert error < tolerance, f"{what}: off by {error:.1e} of its largest value"


def assert_same_outcome(found: Outcome, expected: Outcome, sure: Tensor, tolerance: float):
    assert_close(found.raster.image[sure], expected.raster.image[sure], IMAGE_TOLERANCE, "image")
    assert_close(found.raster.alpha[sure], expected.raster.alpha[sure], IMAGE_TOLERANCE, "alpha")
    assert found.gradients.keys() == expected.gradients.keys()
    for name, gradient in expected.gradients.items():
        assert_close(found.gradients[name], gradient, tolerance, f"gradient of {name}")


def gradient_tolerance(rasterizer: Rasterizer) -> float:
    """Its own where it has one."""
    return getattr(rasterizer, "gradient_tolerance", GRADIENT_TOLERANCE)


def check_against_reference(rasterizer: Rasterizer, case: Case, seed: int = 0):
    cotangents = random_cotangents(case, seed)
    found, expected = run(rasterizer, case, *cotangents), judge(case, *cotangents)
    tolerance = gradient_tolerance(rasterizer)
    assert_same_outcome(found, expected, certain_pixels(case), tolerance)
    ours, theirs = found.raster.footprint, expected.raster.footprint
    assert_close(ours.means2d_gradient, theirs.means2d_gradient, tolerance, "means2d gradient")
    if case.options.absgrad:
        assert_close(ours.absolute_gradient, theirs.absolute_gradient, tolerance, "absolute gradient")
    both = ours.visible & theirs.visible
    assert_close(ours.means2d[both], theirs.means2d[both], IMAGE_TOLERANCE, "means2d")
    # A radius is rounded up to whole pixels: float32 may round the other way.
    assert ((ours.radii - theirs.radii)[both].abs() <= 1).all()
    unseen = ~ours.visible
    assert all((gradient[unseen] == 0).all() for gradient in found.gradients.values())


@pytest.mark.parametrize("channels", [1, 2, 3, 4, 5, 8, 9, 10, 11, 16, 17, 24, 33])
@pytest.mark.parametrize("antialiased", [False, True])
def test_equals_the_reference_for_any_number_of_channels(rasterizer, channels: int, antialiased: bool):
    check_against_reference(rasterizer, random_case(channels, channels=channels, antialiased=antialiased))


@pytest.mark.parametrize("size", [(1, 1), (32, 32), (33, 31), (64, 5), (7, 70), (130, 97)])
@pytest.mark.parametrize("with_factor", [False, True])
def test_equals_the_reference_for_any_image_size(rasterizer, size: tuple[int, int], with_factor: bool):
    check_against_reference(rasterizer, random_case(size[0], size=size, with_factor=with_factor))


@settings(max_examples=20, derandomize=True, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(
    seed=st.integers(0, 2**31),
    count=st.integers(1, 300),
    channels=st.integers(1, 9),
    width=st.integers(1, 70),
    height=st.integers(1, 70),
    antialiased=st.booleans(),
    with_factor=st.booleans(),
)
def test_equals_the_reference_on_random_scenes(
    rasterizer, seed: int, count: int, channels: int, width: int, height: int, antialiased: bool, with_factor: bool
):
    check_against_reference(rasterizer, random_case(seed, count, channels, (width, height), antialiased, with_factor))


@pytest.mark.parametrize(
    "options",
    [
        RasterOptions(max_alpha=0.99),
        RasterOptions(eps2d=0.1),
        RasterOptions(near=3.0),
        RasterOptions(absgrad=False, antialiased=True, eps2d=0.05),
    ],
    ids=["max_alpha", "eps2d", "near", "eps2d-antialiased"],
)
def test_every_option_is_obeyed(rasterizer, options: RasterOptions):
    skip_unless_compiled_in(rasterizer, options.max_alpha)
    case = replace(random_case(5), options=options)
    assert not torch.equal(judge(case, *random_cotangents(case, 0)).raster.image, judge_with_defaults(case))
    check_against_reference(rasterizer, case)


def judge_with_defaults(case: Case) -> Tensor:
    return judge(replace(case, options=RasterOptions()), *random_cotangents(case, 0)).raster.image


def test_an_opaque_stack_stops_before_the_gaussian_that_would_go_too_far(rasterizer):
    """Thirty opaque discs behind one another: all that is behind the stop has exactly no gradient."""
    count = 30
    means = torch.cat([torch.zeros(count, 2), torch.linspace(2, 4, count)[:, None]], 1)
    generator = torch.Generator().manual_seed(2)
    draw = lambda *shape: torch.randn(*shape, generator=generator)  # noqa: E731
    gaussians = Gaussians(means, 0.5 + 0.15 * draw(count, 3), draw(count, 4), torch.full((count,), 2.3))
    camera = Camera(torch.eye(4), (40.0, 40.0), (16.0, 16.0), 32, 32)
    case = Case(gaussians, draw(count, 3), camera, torch.ones(3), RasterOptions(absgrad=True))
    check_against_reference(rasterizer, case)
    outcome = run(rasterizer, case, *random_cotangents(case, 1))
    assert (outcome.gradients["channels"][-5:] == 0).all()
    assert (outcome.gradients["means"][-5:] == 0).all()


def test_no_rows_show_the_background(rasterizer):
    case = random_case(0, count=1)
    empty = replace(
        case,
        gaussians=Gaussians(torch.zeros(0, 3), torch.zeros(0, 3), torch.zeros(0, 4), torch.zeros(0)),
        channels=torch.zeros(0, 3),
    )
    outcome = run(rasterizer, empty, *random_cotangents(empty, 0))
    assert_shows_background(outcome, empty)


def test_rows_behind_the_camera_show_the_background_and_get_zero_gradient(rasterizer):
    case = random_case(0, with_factor=True)
    points = torch.randn(80, 3, generator=torch.Generator().manual_seed(1))
    points[:, 2] = -points[:, 2].abs()
    rotation, shift = case.camera.world_to_camera[:3, :3], case.camera.world_to_camera[:3, 3]
    case = replace(case, gaussians=replace(case.gaussians, means=(points - shift) @ rotation))
    outcome = run(rasterizer, case, *random_cotangents(case, 0))
    assert_shows_background(outcome, case)
    assert not outcome.raster.footprint.visible.any()


def assert_shows_background(outcome: Outcome, case: Case):
    image, alpha = outcome.raster.image, outcome.raster.alpha
    assert torch.equal(image, case.background.expand(image.shape))
    assert (alpha == 0).all()
    assert all((gradient == 0).all() for gradient in outcome.gradients.values())


def test_one_giant_gaussian_covers_the_image(rasterizer):
    gaussians = Gaussians(
        torch.tensor([[0.1, 0.2, 3.0]]), torch.full((1, 3), 6.0), torch.ones(1, 4), torch.tensor([0.4])
    )
    camera = Camera(torch.eye(4), (90.0, 80.0), (40.0, 50.0), 100, 90)
    case = Case(gaussians, torch.tensor([[0.2, 0.5, 0.9]]), camera, torch.zeros(3), RasterOptions(absgrad=True))
    by_image, by_alpha = random_cotangents(case, 0)
    found, expected = run(rasterizer, case, by_image, by_alpha), judge(case, by_image, by_alpha)
    assert_close(found.raster.image, expected.raster.image, IMAGE_TOLERANCE, "image")
    for name in ("channels", "opacity_logits"):
        assert_close(found.gradients[name], expected.gradients[name], gradient_tolerance(rasterizer), name)
    # Its surface is flat across the image: what is left of the geometry's gradients is rounding.
    assert all(gradient.isfinite().all() for gradient in found.gradients.values())


@pytest.mark.parametrize("bad", [float("nan"), float("inf"), float("-inf")])
@pytest.mark.parametrize("column", ["means", "log_scales", "quats", "opacity_logits", "channels", "opacity_factor"])
@pytest.mark.parametrize("want", Want)
def test_what_is_not_finite_is_reported_with_its_place(rasterizer, column: str, bad: float, want: Want):
    case = random_case(11, count=83, with_factor=True)
    tables = case.gaussians.columns() | {"channels": case.channels, "opacity_factor": case.opacity_factor}
    tables[column].view(83, -1)[[0, 7, 31, 80, 82], -1] = bad
    sentence = f"column {column} holds {bad} in rows 0, 7, 31 and 2 more: numbers beyond what can be drawn; remove"
    emission = Emission({"channels": 3}, case.channels, case.opacity_factor)
    with pytest.raises(BackendError, match=sentence):
        rasterizer.draw(case.gaussians, emission, case.camera, case.background, case.options, want)


def test_a_broken_row_is_reported_even_behind_the_camera(rasterizer):
    case = random_case(11)
    behind = int(case.camera.depths(case.gaussians.means).argmin())
    case.gaussians.log_scales[behind, 1] = float("nan")
    with pytest.raises(BackendError, match=f"column log_scales holds nan in row {behind}: "):
        drawn(rasterizer, case.gaussians, case.channels, case.camera, case.background)


def test_a_broken_background_or_camera_is_reported(rasterizer):
    case = random_case(11)
    pose = case.camera.world_to_camera.clone()
    pose[1, 3] = float("inf")
    with pytest.raises(BackendError, match="the background holds a value that is not finite"):
        drawn(rasterizer, case.gaussians, case.channels, case.camera, torch.tensor([0, float("nan"), 0]))
    with pytest.raises(BackendError, match="the camera's pose holds a value that is not finite"):
        drawn(rasterizer, case.gaussians, case.channels, replace(case.camera, world_to_camera=pose), case.background)
    with pytest.raises(BackendError, match="the lens holds a value that is not finite"):
        drawn(
            rasterizer, case.gaussians, case.channels, replace(case.camera, focal=(30.0, float("nan"))), case.background
        )


def test_a_view_can_be_drawn_after_one_that_was_refused(rasterizer):
    case = random_case(11)
    broken = case.channels.clone()
    broken[3] = float("nan")
    with pytest.raises(BackendError, match="row 3: "):
        drawn(rasterizer, case.gaussians, broken, case.camera, case.background)
    check_against_reference(rasterizer, case)


def test_scales_that_overflow_are_not_drawn(rasterizer):
    case = random_case(12)
    case.gaussians.log_scales[3] = 200.0
    outcome = run(rasterizer, case, *random_cotangents(case, 0))
    assert outcome.raster.image.isfinite().all()
    assert all(gradient.isfinite().all() for gradient in outcome.gradients.values())


def test_a_zero_quaternion_is_no_rotation(rasterizer):
    case = random_case(13)
    identity = replace(case, gaussians=replace(case.gaussians, quats=torch.tensor([1.0, 0, 0, 0]).repeat(80, 1)))
    zero = replace(case, gaussians=replace(case.gaussians, quats=torch.zeros(80, 4)))
    cotangents = random_cotangents(identity, 0)
    expected, found = run(rasterizer, identity, *cotangents), run(rasterizer, zero, *cotangents)
    torch.testing.assert_close(found.raster.image, expected.raster.image, rtol=0, atol=1e-6)
    assert (found.gradients["quats"] == 0).all()
    assert_close(
        found.gradients["means"], expected.gradients["means"].double(), gradient_tolerance(rasterizer), "means"
    )


def test_quaternions_of_any_length_turn_alike(rasterizer):
    case = random_case(14)
    longer = replace(case, gaussians=replace(case.gaussians, quats=case.gaussians.quats * 7))
    cotangents = random_cotangents(case, 0)
    found, expected = run(rasterizer, longer, *cotangents), run(rasterizer, case, *cotangents)
    sure = certain_pixels(case)
    assert_close(found.raster.image[sure], expected.raster.image[sure].double(), IMAGE_TOLERANCE, "image")
    assert_close(
        found.gradients["quats"] * 7, expected.gradients["quats"].double(), gradient_tolerance(rasterizer), "quats"
    )


def test_the_background_shows_where_the_gaussians_do_not(rasterizer):
    case = random_case(15)
    black = replace(case, background=torch.zeros(3))
    cotangents = random_cotangents(case, 0)
    over, alone = run(rasterizer, case, *cotangents).raster, run(rasterizer, black, *cotangents).raster
    assert torch.equal(over.alpha, alone.alpha)
    assert_close(over.image, (alone.image + (1 - alone.alpha) * case.background).double(), IMAGE_TOLERANCE, "image")


@pytest.mark.parametrize("only", ["image", "alpha"])
def test_image_and_alpha_pass_gradients_alone(rasterizer, only: str):
    case = random_case(16, channels=4)
    by_image, by_alpha = random_cotangents(case, 0)
    by_image, by_alpha = (by_image, 0 * by_alpha) if only == "image" else (0 * by_image, by_alpha)
    found, expected = run(rasterizer, case, by_image, by_alpha), judge(case, by_image, by_alpha)
    assert_same_outcome(found, expected, certain_pixels(case), gradient_tolerance(rasterizer))


def test_an_output_without_a_gradient_is_no_obstacle(rasterizer):
    case = random_case(16)
    means = case.gaussians.means.clone().requires_grad_()
    table = replace(case.gaussians, means=means)
    for output in ("image", "alpha"):
        raster = drawn(rasterizer, table, case.channels, case.camera, case.background)
        means.grad = None
        getattr(raster, output).sum().backward()
        assert means.grad.abs().sum() > 0
        assert raster.footprint.absolute_gradient is None


def test_depth_may_be_a_channel_and_passes_gradients_to_the_means_twice(rasterizer):
    case = random_case(17)
    by_image, by_alpha = random_cotangents(replace(case, channels=torch.zeros(80, 1)), 0)

    def gradient(rasterizer: Rasterizer, case: Case) -> Tensor:
        means = case.gaussians.means.clone().requires_grad_()
        depths = case.camera.depths(means)[:, None]
        background = torch.zeros(1).to(means)
        raster = drawn(rasterizer, replace(case.gaussians, means=means), depths, case.camera, background)
        torch.autograd.backward([raster.image, raster.alpha], [by_image.to(means), by_alpha.to(means)])
        return means.grad

    exact = gradient(rasterizer_for("reference"), case.to(torch.float64))
    assert_close(gradient(rasterizer, case), exact, gradient_tolerance(rasterizer), "means")


def test_the_order_of_the_rows_does_not_matter(rasterizer):
    case = random_case(18, with_factor=True)
    order = torch.randperm(80, generator=torch.Generator().manual_seed(3))
    moved = replace(
        case,
        gaussians=case.gaussians.rows(order),
        channels=case.channels[order],
        opacity_factor=case.opacity_factor[order],
    )
    cotangents = random_cotangents(case, 0)
    found, expected = run(rasterizer, moved, *cotangents), run(rasterizer, case, *cotangents)
    assert torch.equal(found.raster.image, expected.raster.image)
    for name, gradient in expected.gradients.items():
        assert_close(found.gradients[name], gradient[order].double(), 1e-5, name)


def test_the_same_call_gives_the_same_bits(rasterizer):
    skip_where_sums_have_no_order(rasterizer)
    case = random_case(19, channels=5, size=(70, 50))
    first, second = (run(rasterizer, case, *random_cotangents(case, 0)) for _ in range(2))
    assert torch.equal(first.raster.image, second.raster.image)
    assert all(torch.equal(first.gradients[name], second.gradients[name]) for name in first.gradients)


def test_inputs_stay_as_they_were(rasterizer):
    case = random_case(20, with_factor=True)
    before = case.to(torch.float64)
    run(rasterizer, case, *random_cotangents(case, 0))
    after = case.to(torch.float64)
    assert all(
        torch.equal(a, b) for a, b in zip(*(c.gaussians.columns().values() for c in (before, after)), strict=True)
    )
    assert torch.equal(before.channels, after.channels)


# Float32 decides a threshold differently at hardly any pixel, and such a pixel still moves by less than an 8-bit step.
MAX_DOUBTFUL_PIXELS = 4
EIGHT_BIT_STEP = 1 / 255


@pytest.mark.parametrize("name", ORACLES)
def test_equals_gsplat_in_value_and_gradient(rasterizer, name: str):
    """The oracle is float64, the back end float32, and nothing keeps the pixels away from the thresholds here."""
    oracle = load_oracle(name, torch.float32)
    skip_unless_compiled_in(rasterizer, oracle.options.max_alpha)
    arrays, leaves = oracle.arrays, oracle.leaves
    camera = replace(oracle.camera, world_to_camera=oracle.camera.world_to_camera.detach())
    raster = drawn(rasterizer, oracle.gaussians, oracle.channels, camera, oracle.background, oracle.options)
    torch.autograd.backward([raster.image, raster.alpha], oracle.cotangents)
    for found, expected in ((raster.image, arrays["img"]), (raster.alpha, arrays["alpha"][..., None])):
        error = (found - expected).abs().amax(-1)
        assert (error > 2e-5).sum() <= MAX_DOUBTFUL_PIXELS
        assert error.max() < EIGHT_BIT_STEP
    gradients = {f"g_{name}": leaf.grad for name, leaf in leaves.items() if name != "viewmat"}
    gradients["g_means2d"] = raster.footprint.means2d_gradient
    gradients["absgrad_means2d"] = raster.footprint.absolute_gradient
    for key, gradient in gradients.items():
        error = (gradient - arrays[key]).norm() / arrays[key].norm()
        assert error < 1e-4, f"{key}: relative error {error:.1e}"


def test_the_same_bits_for_any_number_of_threads(rasterizer):
    skip_where_sums_have_no_order(rasterizer)
    kernels = pytest.importorskip("ringlight._kernels", reason="needs the compiled module")
    case = random_case(21, count=300, channels=4, size=(100, 70))
    cotangents = random_cotangents(case, 0)
    outcomes = []
    for threads in (1, 2, 3):
        kernels.set_threads(threads)
        outcomes.append(run(rasterizer, case, *cotangents))
    kernels.set_threads(0)
    first = outcomes[0]
    for other in outcomes[1:]:
        assert torch.equal(first.raster.image, other.raster.image)
        assert torch.equal(first.raster.footprint.means2d_gradient, other.raster.footprint.means2d_gradient)
        assert all(torch.equal(first.gradients[name], other.gradients[name]) for name in first.gradients)
