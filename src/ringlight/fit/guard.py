"""A light that collapses is noticed, said, and undone: back to where it was good, and on from there at lower rates.

High rates, or a jump of the gradients, can drive a light to where it hardly learns: its features at the ends of their
range, or its network off everywhere, and hardly anything brings it back (docs/experiments/light-fields.md). So from the
step on that switches the light on, every :data:`CHECK_EVERY` steps, the guard looks at two things: the light's
features, as one training view shows them, and the mean loss since the last look. While both are well it keeps the state
of the training.
"""

import math
from collections.abc import Callable, Mapping, Sequence
from typing import Any, NamedTuple

import torch
from torch import Tensor

from ringlight.core.light_features import FeatureShares
from ringlight.fit.optimizer import Optimizer

CHECK_EVERY = 200
"""Steps: a look and a copy of the state together take less than a hundredth of as many steps."""

FEWEST_LOSSES = CHECK_EVERY // 2
"""Of which a mean says something; between a disturbance and a look there may be fewer."""

COLLAPSED = 0.9
"""Share of saturated, or of constant, features from which on a light looks collapsed. Lights that had collapsed had all
of either. A ring with narrow networks on lego_400 had 0.88, 200 steps after it was switched on, and came out of it by
itself."""

TOO_MANY_OFF = 0.85
"""Share of hidden units that are off, likewise. That ring had 0.66, a network that had collapsed 60 of 64."""

GOOD = 0.1
"""Share of such features up to which a state is worth keeping: one whose features are leaving may be past help."""

GOOD_OFF = 0.7
"""Share of units that are off, likewise."""

RISE = 1.5
"""A loss this many times its lowest mean is no noise: rounds of density control raised it by a fifth, in healthy
runs."""

PATIENCE = 2
"""Looks in a row at which something is wrong: it has stayed so. That ring was worst 250 steps after it was lit."""

SLOWER = 0.5
"""The light's rates are multiplied by this each time."""

MOST_UNDONE = 4
"""Times that a collapse is undone, down to a sixteenth of the rate. A light that collapses still has another cause, or
rates that are wrong by more, and is kept: base colours make a picture, and the run ends with it rather than with
nothing."""

BY_FEATURES, BY_LOSS = 0, 1
"""What told of a collapse."""


class Collapse(NamedTuple):
    """One that was noticed after ``step``. Training went on from ``back_to``, which is ``step`` where it was kept."""

    step: int
    back_to: int
    told_by: int

    def sentence(self, number: int) -> str:
        """What happened; it was the ``number``-th of its run, from 1."""
        how = "its features or units are idle" if self.told_by == BY_FEATURES else "the loss rose and stayed up"
        noticed = f"step {self.step}: the light has collapsed ({how})"
        if number > MOST_UNDONE:
            return f"{noticed} though its rates were lowered {MOST_UNDONE} times; it is kept as it is"
        return f"{noticed}; back to step {self.back_to}, and on with {SLOWER**number:g} of the light's rates"


class Guard:
    """Watches the parameters whose names start with one of ``light``, from step ``begins`` on, which switches it on.

    ``look(index)`` gives the shares of idle features, as the training view of that number shows them (they come round),
    or None. After one of the steps ``disturbed`` the loss rises for good reasons, such as an opacity reset, and is
    compared anew.
    """

    def __init__(
        self,
        light: tuple[str, ...],
        begins: int,
        look: Callable[[int], FeatureShares | None],
        disturbed: frozenset[int] = frozenset(),
    ):
        self.light, self.begins, self.look, self.disturbed = light, begins, look, disturbed
        self.collapses: list[Collapse] = []
        self._good: dict[str, Tensor] = {}
        self._good_lowest = self._lowest = math.inf
        self._sum, self._count, self._high, self._gone = 0.0, 0, 0, 0

    @property
    def is_over(self) -> bool:
        """Whether it has given up."""
        return len(self.collapses) > MOST_UNDONE

    @property
    def bytes_kept(self) -> int:
        """Of the state that is good."""
        return sum(tensor.numel() * tensor.element_size() for tensor in self._good.values())

    def watch(self, step: int, loss: float, state: Callable[[], Mapping[str, Tensor]]) -> Mapping[str, Tensor] | None:
        """Hear of a ``step`` and its photometric ``loss``; ``state`` gives what the training is after it.

        Returns None, or after a collapse the state to go on from, whose numbers the guard keeps.
        """
        if self.is_over:
            return None
        if math.isfinite(loss):
            self._sum, self._count = self._sum + loss, self._count + 1
        if step in self.disturbed:
            self._begin_anew(math.inf)
        if (step - self.begins) % CHECK_EVERY:
            return None
        mean = self._sum / self._count if self._count >= FEWEST_LOSSES else None
        self._sum, self._count = 0.0, 0
        return None if step < self.begins else self._check(step, mean, state)

    def slow(self, optimizer: Optimizer) -> None:
        """Set the light's rates to what they are after these collapses."""
        optimizer.slow(self.light, SLOWER ** min(len(self.collapses), MOST_UNDONE))

    def state(self) -> dict[str, Tensor]:
        """What a resumed run needs; ``good.…`` is a training's state."""
        lowest = (0.0 if math.isinf(mean) else mean for mean in (self._lowest, self._good_lowest))
        numbers = [self._sum, self._count, self._high, self._gone, *lowest]
        own = {
            "numbers": torch.tensor(numbers, dtype=torch.float64),
            "collapses": torch.tensor(self.collapses, dtype=torch.int64).reshape(-1, len(Collapse._fields)),
        }
        return own | {GOOD_PREFIX + name: tensor for name, tensor in self._good.items()}

    def restore(self, state: Mapping[str, Tensor]) -> None:
        """Inverse of :meth:`state`."""
        self._sum, count, high, gone, lowest, good_lowest = state["numbers"].tolist()
        self._count, self._high, self._gone = int(count), int(high), int(gone)
        self._lowest, self._good_lowest = lowest or math.inf, good_lowest or math.inf
        self.collapses = [Collapse(*row) for row in state["collapses"].tolist()]
        self._good = good_state(state)

    def _check(
        self, step: int, mean: float | None, state: Callable[[], Mapping[str, Tensor]]
    ) -> Mapping[str, Tensor] | None:
        # Before its first step the light is what it was drawn as; where the run begins there must be a state to go to.
        shares = None if step == self.begins else self.look((step - self.begins) // CHECK_EVERY)
        is_gone, is_good = _judged(shares)
        self._gone = self._gone + 1 if is_gone else 0
        if mean is not None:
            self._high = self._high + 1 if mean > RISE * self._lowest else 0
            self._lowest = min(self._lowest, mean)
        if max(self._gone, self._high) >= PATIENCE:
            return self._go_back(step, BY_FEATURES if self._gone >= PATIENCE else BY_LOSS)
        if is_good and not self._high:
            self._good = {}  # two at once would be more than is planned for
            self._good = {name: tensor.detach().clone() for name, tensor in state().items()}
            self._good_lowest = self._lowest
        return None

    def _go_back(self, step: int, told_by: int) -> Mapping[str, Tensor] | None:
        good = self._good if len(self.collapses) < MOST_UNDONE else {}
        self.collapses.append(Collapse(step, int(good["step"]) if good else step, told_by))
        self._begin_anew(self._good_lowest)
        self._good, self._gone = good, 0
        return good or None

    def _begin_anew(self, lowest: float) -> None:
        """Hear no more of the losses before this step, but for their ``lowest`` mean."""
        self._sum, self._count, self._high, self._lowest = 0.0, 0, 0, lowest


def _judged(shares: FeatureShares | None) -> tuple[bool, bool]:
    """Whether the light looks collapsed, and whether its state is worth keeping."""
    if shares is None:
        return False, True
    idle = max(shares.saturated, shares.constant)
    return idle >= COLLAPSED or shares.off >= TOO_MANY_OFF, idle <= GOOD and shares.off <= GOOD_OFF


GOOD_PREFIX = "good."
"""Of names in a guard's state."""


def good_state(state: Mapping[str, Any]) -> dict[str, Any]:
    """The training's state that a guard's holds; empty where there is none."""
    return {name.removeprefix(GOOD_PREFIX): t for name, t in state.items() if name.startswith(GOOD_PREFIX)}


def sentences(collapses: Sequence[Collapse]) -> tuple[str, ...]:
    """One for each collapse of a run."""
    return tuple(collapse.sentence(number) for number, collapse in enumerate(collapses, start=1))
