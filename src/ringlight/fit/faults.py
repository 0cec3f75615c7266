"""Numbers that go wrong while a model trains: named, left out, and after too many steps in a row the end of the run.

A loss that is not finite has no gradient worth following: the step leaves every parameter as it was. A gradient that
is not finite, or too large for Adam's moments, leaves its own element as it was, and the others are updated. So no
parameter ever becomes NaN or infinite; a parameter or a moment that is (set so by a strategy or by hand) ends the run
at once.
"""

from collections.abc import Callable, Mapping

from jaxtyping import Float
from torch import Tensor

from ringlight.core.camera import Camera
from ringlight.core.finite import first_not_finite
from ringlight.core.gradients import Gradient
from ringlight.core.rendering import Rendering
from ringlight.data.batches import ImageBatch
from ringlight.errors import BackendError, DivergedError
from ringlight.models.splats import SplatModel

MOST_IN_A_ROW = 10
"""Steps with a fault, one after the other, that a run bears: one photograph that is bad comes up once an epoch."""

REMEDY = "look at that photograph and its pose, or learn at lower rates"


class FaultCounter:
    """Hears of every step, and ends the run after :data:`MOST_IN_A_ROW` bad ones in a row."""

    def __init__(self) -> None:
        self.in_a_row = 0

    def note(
        self, model: SplatModel, moments: Mapping[str, Tensor], step: int, batch: ImageBatch, what: str | None
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
        return f"step {step}, view {batch.view.name}: {what}"

    def refuse_too_many(self, fault: str | None) -> None:
        """Raise DivergedError after a step with a ``fault`` that is one too many in a row."""
        if fault is not None and self.in_a_row >= MOST_IN_A_ROW:
            raise DivergedError(f"{fault}; that was the {self.in_a_row}th bad step in a row; {REMEDY}")


Render = Callable[[Camera, Float[Tensor, "3"]], Rendering]
"""A model's picture over a background: its own ``render``, or that of its direct form."""


def drawn(render: Render, model: SplatModel, step: int, batch: ImageBatch) -> Rendering:
    """The batch's view.

    Raises DivergedError naming the parameter that cannot be drawn because it is not finite, else BackendError naming
    the view, for what the rasterizer refuses: a pose that is not finite, more than the memory holds.
    """
    try:
        return render(batch.camera, batch.background)
    except BackendError as error:
        refuse_broken(model, step, batch)
        raise BackendError(f"step {step}, view {batch.view.name}: {error}") from error


def refuse_broken(model: SplatModel, step: int, batch: ImageBatch) -> None:
    """Raise DivergedError naming the first parameter that is not finite, if there is one."""
    _refuse(dict(model.named_parameters()), "parameter", step, batch)


def _refuse(tensors: Mapping[str, Tensor], kind: str, step: int, batch: ImageBatch) -> None:
    broken = first_not_finite(tensors)
    if broken is not None:
        raise DivergedError(f"step {step}, view {batch.view.name}: {kind} {broken}; {REMEDY}")


def bad_loss(terms: Mapping[str, Tensor]) -> str | None:
    """Which term of the loss is not finite; None where all are."""
    return next((f"the {name} loss is {term.item()}" for name, term in terms.items() if not term.isfinite()), None)


def bad_gradient(gradients: Mapping[str, Gradient], left: int) -> str:
    """Why ``left`` elements were left as they were."""
    broken = first_not_finite({name: g if isinstance(g, Tensor) else g.dense() for name, g in gradients.items()})
    if broken is not None:
        return f"the gradient of {broken} ({left} elements left as they were)"
    return f"gradients too large to be squared ({left} elements left as they were)"
