"""The training loop. Read this first."""

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, field, replace

import torch
from jaxtyping import Float
from torch import Tensor

from ringlight.core.batch import Batch
from ringlight.core.gradients import Gradients
from ringlight.core.origin import Origin
from ringlight.core.rendering import Rendering, no_way_back
from ringlight.core.want import Want
from ringlight.data.contract import Batches
from ringlight.fit.faults import FaultCounter, bad_loss, predicted
from ringlight.fit.guard import Guard, sentences
from ringlight.fit.losses.contract import Compared, Loss
from ringlight.fit.optimizer import Optimizer
from ringlight.fit.regularizers.contract import Regularizer, Term
from ringlight.fit.strategies.contract import AtTheEnd, Strategy
from ringlight.models.contract import Model


def alone(gradients: Gradients) -> Gradients:
    """What one process makes of its gradients."""
    return gradients


@dataclass
class Training:
    """What a recipe builds and :func:`train` consumes. ``step`` counts the steps already done.

    ``reduce`` is where several processes make one of their gradients; ``guard`` watches a light; ``origin`` is that of
    the points on which the first rows lie, None where they lie on none or on a model's own. Raises RecipeError for a
    regularizer of a buffer that the model does not blend.
    """

    model: Model
    batches: Batches
    loss: Loss
    optimizer: Optimizer
    strategies: tuple[Strategy, ...]
    steps: int
    regularizers: Mapping[str, Regularizer] = field(default_factory=dict)
    reduce: Callable[[Gradients], Gradients] = alone
    faults: FaultCounter = field(default_factory=FaultCounter)
    guard: Guard | None = None
    origin: Origin | None = None
    step: int = 0

    def __post_init__(self) -> None:
        self.model.refuse_unblended(self.loss.buffers, "the loss")
        for name, regularizer in self.regularizers.items():
            self.model.refuse_unblended(regularizer.buffers, f"the {name} regularizer")

    def regularizers_at(self, step: int) -> dict[str, Regularizer]:
        """Those that look at this step."""
        return {name: regularizer for name, regularizer in self.regularizers.items() if regularizer.looks(step)}

    def buffers_at(self, step: int) -> tuple[str, ...]:
        """What the loss and regularizers look at of this step's prediction."""
        lookers: tuple[Loss | Regularizer, ...] = (self.loss, *self.regularizers_at(step).values())
        return tuple({name: None for looker in lookers for name in looker.buffers})

    def extend(self, added: int) -> None:
        """Let the run have ``added`` more steps. What strategies do by its length is not done again, but for those
        ``AtTheEnd``."""
        self.optimizer.extend(added)
        for strategy in self.strategies:
            if isinstance(strategy, AtTheEnd):
                strategy.extend(added)
        self.steps += added

    def state(self) -> dict[str, Tensor]:
        """Every tensor that a run needs to go on as if it had never stopped."""
        of_guard = self.guard.state() if self.guard else {}
        return self._own_state() | {f"guard.{name}": tensor for name, tensor in of_guard.items()}

    def _own_state(self) -> dict[str, Tensor]:
        """What the next steps depend on: all but what the guard remembers."""
        state = {f"model.{name}": tensor for name, tensor in self.model.state_dict().items()}
        state |= {f"optimizer.{name}": tensor for name, tensor in self.optimizer.state().items()}
        for index, strategy in enumerate(self.strategies):
            state |= {f"strategy.{index}.{name}": tensor for name, tensor in strategy.state().items()}
        return state | {"step": torch.tensor(self.step), "faults": torch.tensor(self.faults.in_a_row)}

    def bytes_by_part(self) -> dict[str, int]:
        """What lies in memory from step to step: "parameters", "moments", "photographs" as the loss wants them, what
        "strategies" count, and the "good state" of a guard. Not what a step itself works in: gradients, images, the
        rasterizer's workspace."""
        held = {
            "parameters": self.model.parameters(),
            "moments": self.optimizer.moments.values(),
            "strategies": (tensor for strategy in self.strategies for tensor in strategy.state().values()),
        }
        sizes = {part: sum(t.numel() * t.element_size() for t in tensors) for part, tensors in held.items()}
        kept = {"good state": self.guard.bytes_kept} if self.guard else {}
        return sizes | {"photographs": self.loss.bytes_kept} | kept

    def restore(self, state: Mapping[str, Tensor]) -> None:
        """Inverse of :meth:`state`; the model takes the saved sizes."""
        if self.guard is not None:
            self.guard.restore(_below(state, "guard."))
            self.guard.slow(self.optimizer)
        self._restore_own(state)

    def undo_collapse(self, loss: float) -> str | None:
        """After a step with this photometric ``loss``: a sentence where the guard finds that the light has collapsed.

        The training is then what it was at an earlier step, with lower rates; see :mod:`ringlight.fit.guard`.
        """
        if self.guard is None:
            return None
        before = len(self.guard.collapses)
        good = self.guard.watch(self.step, loss, self._own_state)
        if good is not None:
            self._restore_own(good)
            self.guard.slow(self.optimizer)
        return None if len(self.guard.collapses) == before else sentences(self.guard.collapses)[-1]

    def _restore_own(self, state: Mapping[str, Tensor]) -> None:
        self.model.load_tensors(_below(state, "model."))
        self.optimizer.restore(_below(state, "optimizer."))
        for index, strategy in enumerate(self.strategies):
            strategy.restore(_below(state, f"strategy.{index}."))
        self.step, self.faults.in_a_row = int(state["step"]), int(state["faults"])


@dataclass(frozen=True)
class Progress:
    """What happened in one step. ``prediction`` and ``truth`` are what the loss compared, before the update.
    ``weights`` are those of pixels in it, None where all count alike.

    ``fault`` is a sentence on a number that was not finite, ``collapse`` one on a light that collapsed, after which the
    training may have gone back to an earlier step; both are None in nearly all steps.
    """

    step: int
    losses: dict[str, Float[Tensor, ""]]
    batch: Batch
    prediction: Rendering
    truth: Float[Tensor, "*pixels 3"]
    fault: str | None = None
    collapse: str | None = None
    weights: Float[Tensor, "*pixels"] | None = None

    @property
    def loss(self) -> float:
        """The sum of all terms."""
        return float(sum(term.item() for term in self.losses.values()))


def train(training: Training) -> Iterator[Progress]:
    """Fit the model in place, yielding after every step; to pause or stop is to stop asking.

    Steps come in order, but that after one with a ``collapse`` may be an earlier one again.

    Raises DivergedError by the rules of :mod:`ringlight.fit.faults`; where all parameters are finite, ``training`` is
    then as its last step left it, and that step is counted.
    """
    model, optimizer = training.model, training.optimizer
    while training.step < training.steps:
        step = training.step + 1
        batch = training.batches.at(step)
        prediction = predicted(model, step, batch, Want.GRADIENTS, training.buffers_at(step))
        compared = training.loss.compare(prediction, batch, model)
        terms = {name: r.term(step, model, prediction) for name, r in training.regularizers_at(step).items()}
        losses = {"photometric": compared.value} | {name: term.value for name, term in terms.items()}
        fault = bad_loss(losses)
        if fault is None:
            fault = optimizer.step(step, gradients_of(training, prediction, compared, terms), prediction.footprint)
        else:
            prediction = replace(prediction, backward=no_way_back)  # what it holds is free for the next step
        fault = training.faults.note(model, optimizer.moments, step, batch, fault)
        for strategy in training.strategies:
            strategy.update(step, model, optimizer, prediction)
        training.step = step
        collapse = training.undo_collapse(compared.value.item())
        yield Progress(step, losses, batch, prediction, compared.truth, fault, collapse, compared.weights)
        training.faults.refuse_too_many(fault)


def gradients_of(training: Training, prediction: Rendering, compared: Compared, terms: Mapping[str, Term]) -> Gradients:
    """Of the loss and of all regularizers, by parameter name; reduced over the processes, if there are several."""
    grad_buffers: dict[str, Tensor] = {}
    lookers: tuple[Compared | Term, ...] = (compared, *terms.values())
    for looker in lookers:
        for name, gradient in looker.grad_buffers.items():
            grad_buffers[name] = grad_buffers[name] + gradient if name in grad_buffers else gradient
    gradients = prediction.backward(compared.grad_color, grad_buffers)
    for looker in lookers:
        gradients.add_all(looker.grad_parameters)
    return training.reduce(gradients)


def _below(state: Mapping[str, Tensor], prefix: str) -> dict[str, Tensor]:
    return {name.removeprefix(prefix): tensor for name, tensor in state.items() if name.startswith(prefix)}
