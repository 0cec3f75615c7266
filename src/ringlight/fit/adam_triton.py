"""One Adam update of all parameters on a GPU by one Triton kernel, whatever their number.

The kernel finds its tensors by address, as torch's own multi-tensor updates do: one launch and two small copies a step,
instead of a launch for each of some thirty parameters. Its reference is ``adam_reference_``.
"""

from collections.abc import Sequence

import torch
import triton
import triton.language as tl
from jaxtyping import Float, Int
from torch import Tensor

from ringlight.core.gradients import AdamStep

BLOCK = 1024
"""Elements at a time."""

MOST_PROGRAMS = 1024
"""For one parameter: several waves of any GPU; a program goes on to further blocks."""

Group = tuple[Tensor, Tensor, Tensor, Tensor, AdamStep]
"""Value, gradient, both moments, and the step."""


@triton.jit
def _adam(tensors, rates, radii, left, ROWS: tl.constexpr, SIZE: tl.constexpr):
    """``tensors`` [P 6]: addresses of value, gradient, mean, square; number of elements, and of elements a row.

    ``rates`` [P 5]: step size, both betas, epsilon, and what unbiases the root of the squares. With ``ROWS`` only rows
    with a radius change. ``left`` counts elements that would not be finite.
    """
    parameter = tl.program_id(1)
    pointers = tensors + parameter * 6
    value_at = tl.load(pointers).to(tl.pointer_type(tl.float32))
    gradient_at = tl.load(pointers + 1).to(tl.pointer_type(tl.float32))
    mean_at = tl.load(pointers + 2).to(tl.pointer_type(tl.float32))
    square_at = tl.load(pointers + 3).to(tl.pointer_type(tl.float32))
    count = tl.load(pointers + 4)
    width = tl.load(pointers + 5)
    size = tl.load(rates + parameter * 5)
    beta1 = tl.load(rates + parameter * 5 + 1)
    beta2 = tl.load(rates + parameter * 5 + 2)
    epsilon = tl.load(rates + parameter * 5 + 3)
    unbias = tl.load(rates + parameter * 5 + 4)
    broken = tl.zeros((SIZE,), tl.int32)
    for begin in range(tl.program_id(0) * SIZE, count, tl.num_programs(0) * SIZE):
        element = begin + tl.arange(0, SIZE)
        inside = element < count
        if ROWS:
            inside = inside & (tl.load(radii + 2 * (element // width), mask=inside, other=0.0) > 0)
        value = tl.load(value_at + element, mask=inside, other=0.0)
        gradient = tl.load(gradient_at + element, mask=inside, other=0.0)
        mean = tl.load(mean_at + element, mask=inside, other=0.0)
        square = tl.load(square_at + element, mask=inside, other=0.0)
        mean += (gradient - mean) * (1 - beta1)
        square = square * beta2 + gradient * gradient * (1 - beta2)
        value -= size * mean / (tl.sqrt(square) * unbias + epsilon)
        # A difference with itself is zero for finite numbers only.
        fine = (mean - mean == 0) & (square - square == 0) & (value - value == 0)
        tl.store(value_at + element, value, mask=inside & fine)
        tl.store(mean_at + element, mean, mask=inside & fine)
        tl.store(square_at + element, square, mask=inside & fine)
        broken += (inside & (fine == 0)).to(tl.int32)
    tl.atomic_add(left, tl.sum(broken))


def adam_by_triton_(groups: Sequence[Group], radii: Float[Tensor, "N 2"] | None = None) -> Int[Tensor, "1"]:
    """Update all in place; every tensor is contiguous float32 on one device. Returns how many elements were left."""
    values = [group[0] for group in groups]
    device = values[0].device
    table = [[*(tensor.data_ptr() for tensor in group[:4]), group[0].numel(), _width(group[0])] for group in groups]
    tensors = torch.tensor(table, dtype=torch.int64).to(device)
    rates = torch.tensor([_numbers(*group[4]) for group in groups], dtype=torch.float32)
    left = torch.zeros(1, dtype=torch.int32, device=device)
    largest = max(value.numel() for value in values)
    grid = (min(max(triton.cdiv(largest, BLOCK), 1), MOST_PROGRAMS), len(groups))
    seen = left if radii is None else radii.contiguous()
    _adam[grid](tensors, rates.to(device), seen, left, ROWS=radii is not None, SIZE=BLOCK)
    return left


def _width(value: Tensor) -> int:
    """Elements a row."""
    return value[0].numel() if value.ndim and len(value) else 1


def _numbers(rate: float, beta1: float, beta2: float, epsilon: float, number: int) -> tuple[float, ...]:
    """Both bias corrections in double precision: float32 loses the first steps' digits."""
    return rate / (1 - beta1**number), beta1, beta2, epsilon, (1 - beta2**number) ** -0.5
