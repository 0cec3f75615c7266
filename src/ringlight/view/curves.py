"""Curves of trainings, for the page's charts."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from ringlight.measure.report import CurvePoint


@dataclass(frozen=True)
class Curves:
    """How a training went, each over its own steps: PSNR of training photographs in dB, loss, and what the model is
    made of."""

    psnr_steps: tuple[int, ...] = ()
    psnr: tuple[float, ...] = ()
    counted: tuple[int, ...] = ()
    loss_steps: tuple[int, ...] = ()
    loss: tuple[float, ...] = ()


def curves_of(points: Sequence[CurvePoint]) -> Curves:
    """Of a run's points, without those at which the picture was perfect: no chart holds them."""
    drawn = [point for point in points if math.isfinite(point.psnr)]
    losses = [(point.step, point.loss) for point in drawn if point.loss is not None and math.isfinite(point.loss)]
    return Curves(
        tuple(point.step for point in drawn),
        tuple(point.psnr for point in drawn),
        tuple(point.counted for point in drawn),
        tuple(step for step, _ in losses),
        tuple(loss for _, loss in losses),
    )


CHARTS = ("training PSNR, dB", "loss", "size, thousands")


def chart_data(curves: Mapping[str, Curves], names: Sequence[str]) -> list[tuple[Float[np.ndarray, "S"], ...] | None]:
    """For each of CHARTS the steps at which any curve has a point, and the value of each of ``names`` there, between
    its points on a straight line and beyond them NaN; None for a chart without a point."""
    own = [curves.get(name, Curves()) for name in names]
    return [
        _shared([(one.psnr_steps, one.psnr) for one in own]),
        _shared([(one.loss_steps, one.loss) for one in own]),
        _shared([(one.psnr_steps, [count / 1e3 for count in one.counted]) for one in own]),
    ]


def _shared(lines: Sequence[tuple[Sequence[int], Sequence[int | float]]]) -> tuple[Float[np.ndarray, "S"], ...] | None:
    steps = np.unique(np.concatenate([np.asarray(at, dtype=np.float64) for at, _ in lines] or [np.zeros(0)]))
    if not len(steps):
        return None
    values = (np.interp(steps, at, ys, np.nan, np.nan) if at else np.full(len(steps), np.nan) for at, ys in lines)
    return (steps, *values)
