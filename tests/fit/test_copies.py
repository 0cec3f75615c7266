"""Copies in one place look like the one that they were made of, and rows are drawn in proportion."""

import math
from fractions import Fraction

import pytest
import torch
from hypothesis import given
from hypothesis import strategies as st

from ringlight.core.camera import Camera
from ringlight.core.gaussians import Gaussians
from ringlight.core.randomness import generator
from ringlight.core.rendering import Emission
from ringlight.fit.strategies.copies import LEAST, MOST_COPIES, as_copies, drawn_rows
from ringlight.rasterize.convention import MIN_ALPHA
from ringlight.rasterize.reference import ReferenceRasterizer

FAINTEST = 0.005

OPACITIES = st.floats(0.01, 0.995)
COPIES = st.integers(1, MOST_COPIES)


def table_of(opacity: float, scale: float = 0.1, rows: int = 1) -> Gaussians:
    drawn = torch.Generator().manual_seed(3)
    return Gaussians(
        torch.zeros(rows, 3),
        torch.tensor([scale, 0.7 * scale, 1.5 * scale]).log().repeat(rows, 1),
        torch.randn(4, generator=drawn).repeat(rows, 1),
        torch.full((rows,), opacity).logit(),
        {"base": torch.rand(rows, 3, generator=drawn)},
    )


def copy_of(table: Gaussians, copies: int, faintest: float = 0.0) -> tuple[float, float]:
    """Opacity of one of so many, and how many times as wide as the table's first row it is."""
    one = as_copies(table, torch.full((len(table),), copies), faintest)
    ratios = (one.log_scales - table.log_scales).double().exp()
    assert torch.allclose(ratios, ratios[0, 0].expand_as(ratios), rtol=1e-5), "all axes alike"
    return float(one.opacities[0].double()), float(ratios[0, 0])


@given(OPACITIES, COPIES)
def test_together_they_let_as_much_light_through(opacity: float, copies: int):
    each, _ = copy_of(table_of(opacity), copies)
    assert (1 - each) ** copies == pytest.approx(1 - opacity, rel=1e-4, abs=1e-6)


@given(OPACITIES, COPIES)
def test_their_blended_alpha_along_a_line_has_the_integral_of_the_one(opacity: float, copies: int):
    """By quadrature, which knows nothing of binomials."""
    each, narrower = copy_of(table_of(opacity), copies)
    places = torch.linspace(-12, 12, 24_001, dtype=torch.float64)
    blended = 1 - (1 - each * (-0.5 * (places / narrower).square()).exp()) ** copies
    integral = torch.trapezoid(blended, places).item()
    assert integral == pytest.approx(opacity * math.sqrt(2 * math.pi), rel=2e-5)


@pytest.mark.parametrize("copies", [2, 3, 7, 20, 51])
@pytest.mark.parametrize("opacity", [0.02, 0.5, 0.97])
def test_the_width_is_that_of_the_papers_double_sum(opacity: float, copies: int):
    """In fractions but for the roots, as the paper writes it: over i from 1 to n, and k from 0 to i - 1."""
    each, narrower = copy_of(table_of(opacity), copies)
    p = Fraction(each)
    by_root = [Fraction(0)] * copies
    for i in range(1, copies + 1):
        for k in range(i):
            by_root[k] += math.comb(i - 1, k) * (-1) ** k * p ** (k + 1)
    # Roots of squares of fractions keep the alternating sum exact to far beyond a double's digits.
    digits = 10**60
    total = sum(term * Fraction(math.isqrt(digits**2 // (k + 1)), digits) for k, term in enumerate(by_root))
    assert narrower == pytest.approx(float(Fraction(opacity) / total), rel=1e-5)


def test_one_alone_keeps_its_bits():
    table = table_of(0.3, rows=4)
    kept = as_copies(table, torch.tensor([1, 2, 1, 3]), FAINTEST)
    for name, column in kept.columns().items():
        assert torch.equal(column[[0, 2]], table.columns()[name][[0, 2]])


def test_of_a_copy_only_opacity_and_scales_are_others():
    table = table_of(0.3)
    copy = as_copies(table, torch.tensor([5]), FAINTEST).columns()
    assert {n for n, c in copy.items() if not torch.equal(c, table.columns()[n])} == {"log_scales", "opacity_logits"}


def test_more_than_the_most_are_taken_for_as_many():
    assert copy_of(table_of(0.6), 300) == copy_of(table_of(0.6), MOST_COPIES)


def test_a_copy_is_not_dead_at_once():
    each, _ = copy_of(table_of(0.02), 40, FAINTEST)
    assert each == pytest.approx(FAINTEST, rel=1e-4)


@pytest.mark.parametrize("logit", [-90.0, 17.0, 90.0])
def test_opacities_at_the_end_of_floats_stay_finite(logit: float):
    table = table_of(0.5, rows=MOST_COPIES)
    table.opacity_logits.fill_(logit)
    copies = as_copies(table, torch.arange(1, MOST_COPIES + 1), FAINTEST)
    assert copies.log_scales.isfinite().all()
    assert copies.opacity_logits.isfinite().all()
    assert (copies.opacities[1:] <= 1 - LEAST / 2).all()


@pytest.mark.parametrize(
    ("opacity", "copies", "apart"), [(0.1, 2, 1e-3), (0.5, 2, 0.01), (0.5, 10, 0.02), (0.9, 4, 0.05)]
)
def test_the_picture_stays(opacity: float, copies: int, apart: float):
    """To what the paper's approximation leaves, and what each copy loses where its alpha is under 1/255."""
    whole, many = table_of(opacity), table_of(opacity, rows=copies)
    split = as_copies(many, torch.full((copies,), copies), FAINTEST)
    one, together = alpha_of(whole), alpha_of(split)
    assert one.max() > 0.9 * opacity
    assert one[0, 0] < 0.2 * opacity, "the picture shows where it fades"
    difference = (one - together).abs().max().item()
    assert difference < apart + copies * MIN_ALPHA


def alpha_of(table: Gaussians) -> torch.Tensor:
    """On 48 x 48 pixels; a standard deviation of 0.1 is 8 of them."""
    away = torch.eye(4)
    away[2, 3] = 2.0
    camera = Camera(away, focal=(160.0, 160.0), center=(24.0, 24.0), width=48, height=48)
    emission = Emission({"rgb": 3}, torch.ones(len(table), 3))
    return ReferenceRasterizer().draw(table, emission, camera, torch.zeros(3)).alpha


@given(st.lists(st.sampled_from([0.0, 0.1, 0.5, 1.0]), min_size=1, max_size=40).filter(any), st.integers(0, 200))
def test_rows_without_weight_are_never_drawn(weights: list[float], count: int):
    drawn = drawn_rows(torch.tensor(weights), count, generator(1, 2, "test"))
    assert drawn.shape == (count,)
    assert (torch.tensor(weights)[drawn] > 0).all()


def test_rows_are_drawn_in_proportion_to_their_weights():
    weights, count = torch.tensor([0.0, 1.0, 2.0, 0.0, 5.0, 0.01]), 100_000
    drawn = torch.bincount(drawn_rows(weights, count, generator(1, 2, "test")), minlength=6)
    expected = weights / weights.sum() * count
    deviations = (drawn - expected).abs() / expected.sqrt().clamp_min(1)
    assert deviations.max() < 4


@pytest.mark.parametrize("copies", [1, 2, 7])
def test_what_adds_to_the_opacity_is_shared_out_like_it(copies: int):
    table = table_of(0.4, rows=2)
    table.appearance["opacity_rest"] = torch.tensor([[0.2, -0.4], [0.0, 0.1]])
    shared = as_copies(table, torch.tensor([copies, 1]), 0.0, ("opacity_rest",))
    share = float(shared.opacities[0] / table.opacities[0])
    assert share == pytest.approx((1 - 0.6 ** (1 / copies)) / 0.4)
    torch.testing.assert_close(shared.appearance["opacity_rest"][0], share * table.appearance["opacity_rest"][0])
    assert torch.equal(shared.appearance["opacity_rest"][1], table.appearance["opacity_rest"][1])
    assert torch.equal(shared.appearance["base"], table.appearance["base"])
