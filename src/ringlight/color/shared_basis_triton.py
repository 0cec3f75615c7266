"""A shared basis as Triton kernels: colours and opacity factors in one launch, their gradients in one and a sum.

Each of the K shared functions has four values towards a direction: red, green, blue and a logit of opacity. They stand
side by side, function by function, in one row of 4 K numbers, which the Gaussian's weights mix. Nothing but the colours
is kept for the way back. Each of its programs goes over many blocks of rows and adds the gradients of what is shared to
a slab of its own, as in ``fields/perceptron_triton.py``: the same bits each time. The references are
``sh_colors_reference`` and ``factors_reference``.
"""

from dataclasses import dataclass

import torch
import triton
import triton.language as tl
from jaxtyping import Float
from torch import Tensor

from ringlight.color.harmonics_triton import direction_to, harmonic, norms_on, unclamped
from ringlight.core.sh_basis import basis_count
from ringlight.core.triton_kernels import VARYING
from ringlight.fields.perceptron_triton import LEAST

ROWS = 32
"""Gaussians a block; with twice as many the way back spills a third of a kilobyte a thread."""

MOST_PROGRAMS = 512
"""Of the way back; each has a slab of gradients of what is shared."""

LAUNCH = {"num_stages": 1}
"""One stage: the next block's part of the slab may not be fetched before this block has added to it."""

RGB, VALUES = 3, 4
"""Colours, and values of a function."""


@triton.jit
def _coefficients(basis, moves, used, entries, SIZE: tl.constexpr, ALL: tl.constexpr, MOVES: tl.constexpr):
    """[16 W]: value ``entries % 4`` of function ``entries // 4`` by harmonic; zero from harmonic ``used`` on."""
    index = tl.arange(0, 16)[:, None]
    value = (entries % 4)[None, :]
    place = (entries // 4)[None, :] * ALL + index
    known = (entries // 4 < SIZE)[None, :] & (index < used)
    found = tl.load(basis + place * 3 + value, mask=known & (value < 3), other=0.0)
    if MOVES:
        found += tl.load(moves + place, mask=known & (value == 3), other=0.0)
    return found


@triton.jit
def _harmonics(x, y, z, norms, B: tl.constexpr):
    """All from degree 1 on, [B 16], the last zero, and their slopes by x, y and z."""
    index = tl.arange(0, 16)[None, :]
    heights = tl.zeros((B, 16), tl.float32)
    by_x, by_y, by_z = heights, heights, heights
    for k in tl.static_range(15):
        height, slope_x, slope_y, slope_z = harmonic(k, x, y, z, norms)
        heights = tl.where(index == k, height[:, None], heights)
        by_x = tl.where(index == k, slope_x[:, None], by_x)
        by_y = tl.where(index == k, slope_y[:, None], by_y)
        by_z = tl.where(index == k, slope_z[:, None], by_z)
    return heights, by_x, by_y, by_z


@triton.jit
def _constant(constants, place, mask, norms, LOGITS: tl.constexpr):
    """The colour without a direction, and its slope by what is stored: a coefficient, or the colour's logit."""
    stored = tl.load(constants + place, mask=mask, other=0.0)
    if LOGITS:
        color = tl.sigmoid(stored)
        slope = color * (1 - color)
    else:
        slope = tl.load(norms) + stored * 0.0
        color = tl.load(norms + 9) + slope * stored
    return color, slope


@triton.jit(do_not_specialize=VARYING)
def _emit(
    means, constants, logits, weights, basis, moves, norms, channels, factors,
    count, stride, used, least, from_x, from_y, from_z,
    SIZE: tl.constexpr, WIDE: tl.constexpr, ALL: tl.constexpr, LOGITS: tl.constexpr,
    MOVES: tl.constexpr, B: tl.constexpr,
):  # fmt: skip
    """Writes the first three of a row's ``stride`` channels. Without MOVES logits, moves and factors are not used."""
    row = tl.program_id(0) * B + tl.arange(0, B)
    mask = row < count
    entries = tl.arange(0, WIDE)
    x, y, z, _ = direction_to(means, from_x, from_y, from_z, row, mask, tl.load(norms + 10))
    heights, _, _, _ = _harmonics(x, y, z, norms, B)
    towards = tl.dot(heights, _coefficients(basis, moves, used, entries, SIZE, ALL, MOVES), input_precision="ieee")
    known = mask[:, None] & (entries // 4 < SIZE)[None, :]
    mixed = towards * tl.load(weights + row[:, None] * SIZE + (entries // 4)[None, :], mask=known, other=0.0)
    for c in tl.static_range(3):
        color, _ = _constant(constants, row * 3 + c, mask, norms, LOGITS)
        color += tl.sum(tl.where((entries % 4 == c)[None, :], mixed, 0.0), 1)
        tl.store(channels + row * stride + c, tl.maximum(color, 0.0), mask=mask)
    if MOVES:
        logit = tl.load(logits + row, mask=mask, other=0.0)
        moved = tl.sum(tl.where((entries % 4 == 3)[None, :], mixed, 0.0), 1)
        tl.store(factors + row, tl.sigmoid(logit + moved) / tl.maximum(tl.sigmoid(logit), least), mask=mask)


@triton.jit(do_not_specialize=VARYING)
def _emit_gradient(
    means, constants, logits, weights, basis, moves, norms, channels, upstream, by_factors,
    grad_means, grad_constants, grad_logits, grad_weights, slabs,
    count, stride, used, least, from_x, from_y, from_z,
    SIZE: tl.constexpr, WIDE: tl.constexpr, ALL: tl.constexpr, LOGITS: tl.constexpr,
    MOVES: tl.constexpr, B: tl.constexpr,
):  # fmt: skip
    """A colour that was clamped at black has no gradient. ``slabs`` [programs K ALL 4] are zero before."""
    entries = tl.arange(0, WIDE)
    value = (entries % 4)[None, :]
    function = entries // 4
    coefficients = _coefficients(basis, moves, used, entries, SIZE, ALL, MOVES)
    index = tl.arange(0, 16)[:, None]
    place = slabs + tl.program_id(0) * (SIZE * ALL * 4) + (function[None, :] * ALL + index) * 4 + value
    stored = (function < SIZE)[None, :] & (index < used)
    for begin in range(tl.program_id(0) * B, count, tl.num_programs(0) * B):
        row = begin + tl.arange(0, B)
        mask = row < count
        x, y, z, inverse = direction_to(means, from_x, from_y, from_z, row, mask, tl.load(norms + 10))
        heights, slope_x, slope_y, slope_z = _harmonics(x, y, z, norms, B)
        towards = tl.dot(heights, coefficients, input_precision="ieee")
        known = mask[:, None] & (function < SIZE)[None, :]
        weight = tl.load(weights + row[:, None] * SIZE + function[None, :], mask=known, other=0.0)
        by_value = tl.zeros((B, WIDE), tl.float32)
        for c in tl.static_range(3):
            by_color = unclamped(channels, upstream, row * stride + c, mask)
            _, slope = _constant(constants, row * 3 + c, mask, norms, LOGITS)
            tl.store(grad_constants + row * 3 + c, slope * by_color, mask=mask)
            by_value += tl.where(value == c, by_color[:, None], 0.0)
        if MOVES:
            logit = tl.load(logits + row, mask=mask, other=0.0)
            moved = tl.sigmoid(logit + tl.sum(tl.where(value == 3, towards * weight, 0.0), 1))
            mean = tl.sigmoid(logit)
            by_factor = tl.load(by_factors + row, mask=mask, other=0.0) / tl.maximum(mean, least)
            by_moved = by_factor * moved * (1 - moved)
            by_mean = tl.where(mean > least, by_factor * moved * (1 - mean), 0.0)
            tl.store(grad_logits + row, by_moved - by_mean, mask=mask)
            by_value += tl.where(value == 3, by_moved[:, None], 0.0)
        by_weight = tl.sum(tl.reshape(towards * by_value, (B, WIDE // 4, 4)), 2)
        functions = tl.arange(0, WIDE // 4)
        written = mask[:, None] & (functions < SIZE)[None, :]
        tl.store(grad_weights + row[:, None] * SIZE + functions[None, :], by_weight, mask=written)
        by_height = weight * by_value
        by_harmonic = tl.dot(by_height, tl.trans(coefficients), input_precision="ieee")
        grad_x = tl.sum(by_harmonic * slope_x, 1)
        grad_y = tl.sum(by_harmonic * slope_y, 1)
        grad_z = tl.sum(by_harmonic * slope_z, 1)
        shared = tl.load(place, mask=stored, other=0.0) + tl.dot(tl.trans(heights), by_height, input_precision="ieee")
        tl.store(place, shared, mask=stored)
        along = grad_x * x + grad_y * y + grad_z * z
        tl.store(grad_means + row * 3, (grad_x - along * x) * inverse, mask=mask)
        tl.store(grad_means + row * 3 + 1, (grad_y - along * y) * inverse, mask=mask)
        tl.store(grad_means + row * 3 + 2, (grad_z - along * z) * inverse, mask=mask)


@dataclass(frozen=True)
class MovedOpacities:
    """Logits, what moves them with the direction, and the least mean as LEAST_MEAN in ``color/basis_opacities.py``."""

    logits: Float[Tensor, "N"]
    moves: Float[Tensor, "K J"]
    least: float


@dataclass(frozen=True)
class BasisRows:
    """What is emitted: ``constants`` are coefficients of the constant harmonic or, with ``by_logits``, the logits of
    the colours without a direction. All are contiguous float32 on one GPU."""

    means: Float[Tensor, "N 3"]
    constants: Float[Tensor, "N 3"]
    weights: Float[Tensor, "N K"]
    basis: Float[Tensor, "K J 3"]
    position: Float[Tensor, "3"]
    degree: int
    opacities: MovedOpacities | None = None
    by_logits: bool = False

    def emit(self, channels: Float[Tensor, "N C"]) -> Float[Tensor, "N"] | None:
        """Writes the first three channels; returns the opacity factors, if there are any."""
        count, factors = len(self.means), None if self.opacities is None else torch.empty_like(self.opacities.logits)
        if count:
            _emit[(triton.cdiv(count, ROWS),)](
                *self._read(), channels, self.means if factors is None else factors, *self._numbers(channels)
            )
        return factors

    def gradients(
        self, channels: Float[Tensor, "N C"], upstream: Float[Tensor, "N C"], by_factors: Float[Tensor, "N"] | None
    ) -> "BasisGradients":
        """``channels`` as :meth:`emit` left them; ``upstream`` is contiguous."""
        count, unread = len(self.means), self.means
        programs = max(min(triton.cdiv(count, ROWS), MOST_PROGRAMS), 1)
        slabs = self.means.new_zeros(programs, *self.basis.shape[:2], VALUES)
        by_means, by_constants, by_weights = map(torch.empty_like, (self.means, self.constants, self.weights))
        by_logits = None
        if self.opacities is not None:
            by_logits = torch.empty_like(self.opacities.logits)
            by_factors = torch.zeros_like(by_logits) if by_factors is None else by_factors.contiguous()
        if count:
            written = by_means, by_constants, unread if by_logits is None else by_logits, by_weights, slabs
            given = channels, upstream, unread if by_factors is None else by_factors
            _emit_gradient[(programs,)](*self._read(), *given, *written, *self._numbers(channels), **LAUNCH)
        shared = slabs.sum(0)
        by_basis, by_moves = shared[..., :RGB].contiguous(), shared[..., RGB].contiguous()
        return BasisGradients(
            by_means, by_constants, by_weights, by_basis, by_logits, None if by_logits is None else by_moves
        )  # fmt: skip

    def _read(self) -> tuple[Tensor, ...]:
        unread = self.means
        logits, moves = (unread, unread) if self.opacities is None else (self.opacities.logits, self.opacities.moves)
        return self.means, self.constants, logits, self.weights, self.basis, moves, norms_on(self.means.device)

    def _numbers(self, channels: Tensor) -> tuple[int | float | bool, ...]:
        size, stored, _ = self.basis.shape
        wide = max(triton.next_power_of_2(VALUES * size), LEAST)
        sizes = (size, wide, stored, self.by_logits, self.opacities is not None, ROWS)
        used, least = basis_count(self.degree) - 1, 0.0 if self.opacities is None else self.opacities.least
        return len(channels), channels.shape[1], used, least, *self.position.tolist(), *sizes


@dataclass(frozen=True)
class BasisGradients:
    """By what :class:`BasisRows` holds; the last two where opacities vary."""

    means: Float[Tensor, "N 3"]
    constants: Float[Tensor, "N 3"]
    weights: Float[Tensor, "N K"]
    basis: Float[Tensor, "K J 3"]
    logits: Float[Tensor, "N"] | None
    moves: Float[Tensor, "K J"] | None
