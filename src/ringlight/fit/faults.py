"""Numbers that go wrong while a model trains: named, left out, and after too many steps in a row the end of the run.

A loss that is not finite has no gradient worth following: the step leaves every parameter as it was. A gradient that
is not finite, or too large for Adam's moments, leaves its own element as it was, and the others are updated but for
those that a map of steps mixes it with (``Optimizer.scale``). So no
parameter ever becomes NaN or infinite; a parameter or a moment that is (set so by a strategy or by hand) ends the run
at once.
"""

from collections.abc import Mapping, Sequence

from torch import Tensor

from ringlight.core.batch import Batch
from ringlight.core.finite import first_not_finite
from ringlight.core.gradients import Gradient, dense
from ringlight.core.rendering import Rendering
from ringlight.core.want import Want
from ringlight.core.words import counted
from ringlight.errors import BackendError, DivergedError
from ringlight.models.contract import Model

MOST_IN_A_ROW = 10
"""Steps with a fault, one after the other, that a run bears: one photograph that is bad comes up once an epoch."""

REMEDY = "look at that photograph and its pose, or learn at lower rates"


class FaultCounter:
    """Hears of every step, and ends the run after :data:`MOST_IN_A_ROW` bad ones in a row."""

    def __init__(self) -> None:
        self.in_a_row = 0

    def note(
        self, model: Model, moments: Mapping[str, Tensor], step: int, batch: Batch, what: str | None
    ) -> str | None:
        """``what`` went wrong, or None; returns the sentence that names it.

        Raises DivergedError for a parameter, or a moment of Adam's, that is not finite.
        """
        if what is None:
            self.in_a_row = 0
            return None
        refuse_broken(model, step, batch)
        _refuse(moments, "Adam's", step, batch)
        self.in_a_row += 1
        return f"step {step}, {batch.label}: {what}"

    def refuse_too_many(self, fault: str | None) -> None:
        """Raise DivergedError after a step with a ``fault`` that is one too many in a row."""
        if fault is not None and self.in_a_row >= MOST_IN_A_ROW:
            raise DivergedError(f"{fault}; that was the {self.in_a_row}th bad step in a row; {REMEDY}")


def predicted(model: Model, step: int, batch: Batch, want: Want, buffers: Sequence[str]) -> Rendering:
    """What the model shows of the batch.

    Raises DivergedError naming the parameter that cannot be drawn because it is not finite, else BackendError naming
    the batch, for what the back end refuses: a pose that is not finite, more than the memory holds.
    """
    try:
        return model.predict(batch, want, buffers)
    except BackendError as error:
        refuse_broken(model, step, batch)
        raise BackendError(f"step {step}, {batch.label}: {error}") from error


def refuse_broken(model: Model, step: int, batch: Batch) -> None:
    """Raise DivergedError naming the first parameter that is not finite, if there is one."""
    _refuse(dict(model.named_parameters()), "parameter", step, batch)


def _refuse(tensors: Mapping[str, Tensor], kind: str, step: int, batch: Batch) -> None:
    broken = first_not_finite(tensors)
    if broken is not None:
        raise DivergedError(f"step {step}, {batch.label}: {kind} {broken}; {REMEDY}")


def bad_loss(terms: Mapping[str, Tensor]) -> str | None:
    """Which term of the loss is not finite; None where all are."""
    return next((f"the {name} loss is {term.item()}" for name, term in terms.items() if not term.isfinite()), None)


def bad_gradient(gradients: Mapping[str, Gradient], left: int) -> str:
    """Why ``left`` elements were left as they were."""
    broken = first_not_finite({name: dense(gradient) for name, gradient in gradients.items()})
    if broken is not None:
        return f"the gradient of {broken} ({counted(left, 'element')} left as before)"
    return f"gradients too large to be squared ({counted(left, 'element')} left as before)"
