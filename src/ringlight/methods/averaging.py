"""Which steps' models count in the mean that a run keeps, see :class:`ringlight.fit.strategies.AverageAtEnd`."""

from ringlight.errors import RecipeError

AVERAGED = 0.1
"""Share of a run, its last, whose models are averaged where a method does so by default: a fifth is no better
(docs/experiments/averaged-models.md, docs/experiments/putt.md)."""


def check_average(average: float) -> None:
    """Raise RecipeError for what is no share."""
    if not 0 <= average <= 1:
        raise RecipeError(f"average is {average:g}; give a share of the run, from 0 (the last model) to 1")


def first_averaged(average: float, steps: int, reshaped: int) -> int | None:
    """First step whose model counts in the mean of a run's last share ``average``; None where the last one is kept.

    Numbers have to keep their places meanwhile: it lies after ``reshaped``, the last step that moves any.
    """
    first = max(steps - round(average * steps), reshaped) + 1
    return first if average and first < steps else None
