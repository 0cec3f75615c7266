"""The training loop. Read this first."""

from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import dataclass, field

import torch
from jaxtyping import Float
from torch import Tensor

from ringlight.core.rendering import Rendering
from ringlight.data.batches import ImageBatch, ImageBatches
from ringlight.fit.faults import FaultCounter, bad_loss, drawn
from ringlight.fit.losses import PhotometricLoss, Target, photometric_gradient
from ringlight.fit.optimizer import Optimizer
from ringlight.fit.strategies.contract import Strategy
from ringlight.fit.targets import Targets
from ringlight.models.direct import DirectModel
from ringlight.models.splats import SplatModel

Penalty = Callable[[SplatModel], Float[Tensor, ""]]
"""A term of the loss that looks at the model alone."""


@dataclass
class Training:
    """What a recipe builds and :func:`train` consumes. ``step`` counts the steps already done."""

    model: SplatModel
    batches: ImageBatches
    loss: PhotometricLoss
    optimizer: Optimizer
    strategies: tuple[Strategy, ...]
    steps: int
    penalties: Mapping[str, Penalty] = field(default_factory=dict)
    targets: Targets = field(default_factory=Targets)
    faults: FaultCounter = field(default_factory=FaultCounter)
    step: int = 0

    def __post_init__(self) -> None:
        self.targets.device = self.model.device

    def state(self) -> dict[str, Tensor]:
        """Every tensor that a run needs to go on as if it had never stopped."""
        state = {f"model.{name}": tensor for name, tensor in self.model.state_dict().items()}
        state |= {f"optimizer.{name}": tensor for name, tensor in self.optimizer.state().items()}
        for index, strategy in enumerate(self.strategies):
            state |= {f"strategy.{index}.{name}": tensor for name, tensor in strategy.state().items()}
        return state | {"step": torch.tensor(self.step), "faults": torch.tensor(self.faults.in_a_row)}

    def bytes_by_part(self) -> dict[str, int]:
        """What lies in memory from step to step: "parameters", "moments", "photographs" as the loss wants them, and
        what "strategies" count. Not what a step itself works in: gradients, images, the rasterizer's workspace."""
        held = {
            "parameters": self.model.parameters(),
            "moments": self.optimizer.moments.values(),
            "strategies": (tensor for strategy in self.strategies for tensor in strategy.state().values()),
        }
        sizes = {part: sum(t.numel() * t.element_size() for t in tensors) for part, tensors in held.items()}
        return sizes | {"photographs": self.targets.bytes_kept}

    def restore(self, state: Mapping[str, Tensor]) -> None:
        """Inverse of :meth:`state`; the table takes the saved number of rows."""
        self.model.load_columns(_below(state, "model.columns."))
        self.model.load_state_dict(_below(state, "model."))
        self.optimizer.restore(_below(state, "optimizer."))
        for index, strategy in enumerate(self.strategies):
            strategy.restore(_below(state, f"strategy.{index}."))
        self.step, self.faults.in_a_row = int(state["step"]), int(state["faults"])


@dataclass(frozen=True)
class Progress:
    """What happened in one step. ``rendering`` and ``target`` are what the loss compared, before the update.

    ``fault`` is a sentence on a number that was not finite, and None in nearly all steps.
    """

    step: int
    losses: dict[str, Float[Tensor, ""]]
    batch: ImageBatch
    rendering: Rendering
    target: Target
    fault: str | None = None

    @property
    def loss(self) -> float:
        """The sum of all terms."""
        return float(sum(term.item() for term in self.losses.values()))


def train(training: Training, direct: bool = True) -> Iterator[Progress]:
    """Fit the model in place, yielding after every step; to pause or stop is to stop asking.

    Where the model can differentiate itself, autograd is left out: the same bits, sooner. ``direct`` False keeps it.
    Raises DivergedError by the rules of :mod:`ringlight.fit.faults`; where all parameters are finite, ``training`` is
    then as its last step left it, and that step is counted.
    """
    model, optimizer = training.model, training.optimizer
    by_itself = direct_model(training) if direct else None
    render = model.render if by_itself is None else by_itself.render
    fixed_background = training.batches.scene.background != "random"
    while training.step < training.steps:
        step = training.step + 1
        batch = training.batches.at(step)
        target = training.targets.of(batch, fixed_background)
        rendering = drawn(render, model, step, batch)
        value, by_color = photometric_gradient(rendering.color, target, training.loss)
        penalties = {name: penalty(model) for name, penalty in training.penalties.items()}
        terms = {"photometric": value} | {name: term.detach() for name, term in penalties.items()}
        fault = bad_loss(terms)
        if fault is None:
            gradients = None if by_itself is None else by_itself.differentiate(by_color)
            if gradients is None:
                _backward(rendering, by_color, penalties.values())
            radii = None if rendering.raster is None else rendering.raster.footprint.radii
            fault = optimizer.step(step, radii, gradients)
        fault = training.faults.note(model, optimizer.moments, step, batch, fault)
        for strategy in training.strategies:
            strategy.update(step, model, optimizer, rendering)
        training.step = step
        yield Progress(step, terms, batch, rendering, target, fault)
        training.faults.refuse_too_many(fault)


def direct_model(training: Training) -> DirectModel | None:
    """The model without autograd, where it has that form and the loss has no term but the photometric one."""
    return None if training.penalties else training.model.direct()


def _backward(rendering: Rendering, by_color: Float[Tensor, "H W 3"], penalties: Iterable[Float[Tensor, ""]]) -> None:
    """By autograd: the gradients lie in the parameters."""
    sloped = [term for term in penalties if term.requires_grad]  # one that is constant counts all the same
    torch.autograd.backward([rendering.color, *sloped], [by_color, *(None for _ in sloped)])


def _below(state: Mapping[str, Tensor], prefix: str) -> dict[str, Tensor]:
    return {name.removeprefix(prefix): tensor for name, tensor in state.items() if name.startswith(prefix)}
