"""Adam's Triton kernel against the reference."""

import pytest
import torch

import interpreted
from ringlight.fit import adam_triton
from ringlight.fit.adam import Update, adam_reference_
from ringlight.fit.adam_triton import adam_by_triton_

SHAPES = ((700, 3), (700, 15, 3), (700,), (1,), (16, 9))


def updates(shapes: tuple[tuple[int, ...], ...]) -> list[Update]:
    generator = torch.Generator().manual_seed(0)

    def draw(shape: tuple[int, ...]) -> torch.Tensor:
        return torch.randn(shape, generator=generator).to(interpreted.DEVICE)

    return [
        Update(draw(s), draw(s), draw(s), draw(s).abs(), (1e-2 / (n + 1), 0.9, 0.999, 1e-12, 7 * n + 1))
        for n, s in enumerate(shapes)
    ]


def copies(made: list[Update]) -> list[Update]:
    return [Update(*(tensor.clone() for tensor in update[:4]), update.step) for update in made]


def run(made: list[Update], radii: torch.Tensor | None = None) -> int:
    groups = [(u.value, u.gradient, u.mean, u.square, u.step) for u in made]
    return int(adam_by_triton_(groups, radii))


@pytest.mark.parametrize("programs", [adam_triton.MOST_PROGRAMS, 2])
@pytest.mark.parametrize("visible_only", [False, True])
def test_equals_the_reference(visible_only: bool, programs: int, monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setattr(adam_triton, "MOST_PROGRAMS", programs)
    shapes = SHAPES[:3] if visible_only else SHAPES
    ours = updates(shapes)
    theirs = copies(ours)
    radii = None
    if visible_only:
        radii = torch.rand(700, 2, generator=torch.Generator().manual_seed(1)).sub(0.5).relu().to(interpreted.DEVICE)
    assert run(ours, radii) == 0
    for mine, reference in zip(ours, theirs, strict=True):
        before = reference.value.clone()
        adam_reference_(reference, radii)
        for found, expected in zip(
            (mine.value, mine.mean, mine.square), (reference.value, reference.mean, reference.square), strict=True
        ):
            torch.testing.assert_close(found, expected, rtol=1e-5, atol=1e-7)
        if radii is not None:
            assert torch.equal(mine.value[radii[:, 0] == 0], before[radii[:, 0] == 0])


@pytest.mark.filterwarnings("ignore:overflow", "ignore:invalid value")
def test_what_would_not_be_finite_is_left_and_counted():
    [mine] = updates(((300, 3),))
    mine.gradient[7, 1], mine.gradient[8, 0], mine.gradient[9, 2] = float("nan"), float("inf"), 1e30
    before = mine.value.clone()
    assert run([mine]) == 3
    kept = mine.value == before
    assert kept.nonzero().tolist() == [[7, 1], [8, 0], [9, 2]]
    assert all(tensor.isfinite().all() for tensor in (mine.value, mine.mean, mine.square))
