"""Adam by parameter name, and the only code that knows that moments follow rows.

Every change of a parameter's shape goes through the verbs here (``edit_rows``, ``replace``), because resizing a
parameter without its moments is the classic bug of this field.
"""

from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import dataclass
from fnmatch import fnmatchcase
from functools import partial
from itertools import pairwise
from typing import Any

import torch
from jaxtyping import Int
from torch import Tensor, nn

from ringlight.core.gaussians import Gaussians
from ringlight.core.gradients import COLUMNS, Gradient, Gradients, dense
from ringlight.core.rendering import Footprint
from ringlight.core.shared_pieces import each_of
from ringlight.errors import RecipeError
from ringlight.fit.adam import Update, adam_
from ringlight.fit.faults import bad_gradient
from ringlight.fit.rates import Adam


@dataclass(frozen=True)
class Directed:
    """Steps by the rate along what a parameter's own direction makes of the running mean of its gradients, of which a
    new one is the share 1 - ``momentum``. Threads call several at once; none may ask for pieces."""

    directions: Mapping[str, Callable[[Tensor], Tensor]]
    momentum: float


class Optimizer:
    """Steps each parameter by the first group whose pattern matches its name.

    With ``visible_only`` the table's rows that a step did not draw are left alone, moments included, instead of
    drifting on by their momentum. Raises RecipeError for a parameter that no pattern matches: nothing is silently
    frozen; and for columns that shall decay, of which some rows may wait.
    """

    def __init__(self, model: nn.Module, groups: Mapping[str, Adam], steps: int, visible_only: bool = False):
        self.model, self.steps, self.visible_only = model, steps, visible_only
        self.groups = {name: _group_of(name, groups) for name, _ in model.named_parameters()}
        decaying = next((name for name, group in self.groups.items() if group.decay and name.startswith(COLUMNS)), None)
        if decaying is not None:
            raise RecipeError(f"{decaying} shall decay, and columns of a table cannot; give their group no decay")
        self._mean = {name: torch.zeros_like(p) for name, p in model.named_parameters()}
        self._square = {name: torch.zeros_like(p) for name, p in model.named_parameters()}
        self._updates = dict.fromkeys(self.groups, 0)
        self._slowed = dict.fromkeys(self.groups, 1.0)
        self._scalings: Mapping[str, Callable[[Tensor], Tensor]] = {}
        self._directed: Directed | None = None
        self._ends = [0, steps]
        # Names are cut once; what they name is looked up each time, for the verbs below and the model replace it.
        self._attributes: dict[tuple[str, ...], list[tuple[str, str]]] = {}
        for name in self.groups:
            *owner, attribute = name.split(".")
            self._attributes.setdefault(tuple(owner), []).append((name, attribute))

    @torch.no_grad()
    def step(self, step: int, gradients: Gradients, footprint: Footprint | None = None) -> str | None:
        """Update every parameter that has a gradient; returns what was wrong with them, if any.

        ``footprint`` is of this step's prediction; RecipeError if ``visible_only`` wants it and there is none.
        """
        if self.visible_only and footprint is None:
            raise RecipeError(
                "visible_only wants to know which Gaussians this step drew, and the rendering does not say; "
                "switch visible_only off for this method"
            )
        used: dict[str, Gradient] = {}
        columns: list[Update] = []
        shared: list[Update] = []
        seen = self._through_maps({n: dense(found) for n in self._scalings if (found := gradients.get(n)) is not None})
        for name, parameter in self._parameters():
            gradient = gradients.get(name)
            if gradient is None:
                continue
            self._updates[name] += 1
            used[name] = gradient
            self._shrink(name, step, parameter, seen.get(name, gradient))
            if name not in seen:
                update = self._update(name, step, parameter, gradient)
                (columns if self.visible_only and name.startswith(COLUMNS) else shared).append(update)
        left = adam_(shared) + (adam_(columns, footprint.radii) if columns and footprint is not None else 0)
        left += self._step_scaled(step, seen)
        if left == 0:
            return None
        return bad_gradient(used | {f"{name}, scaled,": gradient for name, gradient in seen.items()}, left)

    def _shrink(self, name: str, step: int, parameter: Tensor, gradient: Gradient) -> None:
        """By its group's decay, but for one whose gradient has a fault: that leaves numbers as they were."""
        decay = self.groups[name].decay
        if decay and dense(gradient).square().isfinite().all():
            parameter.mul_(1 - decay * self.rate(name, step))

    def _update(self, name: str, step: int, value: Tensor, gradient: Gradient) -> Update:
        """Adam's, of a parameter whose updates are counted already."""
        group = self.groups[name]
        adam_step = (self.rate(name, step), *group.betas, group.epsilon, self._updates[name])
        return Update(value, gradient, self._mean[name], self._square[name], adam_step)

    def _step_scaled(self, step: int, seen: Mapping[str, Tensor]) -> int:
        """Step parameters by the gradients that their maps show, and through these; returns how many numbers of all
        gradients could not be used."""
        if self._directed is None:
            moved = {name: torch.zeros_like(gradient) for name, gradient in seen.items()}
            left = adam_([self._update(name, step, moved[name], gradient) for name, gradient in seen.items()])
        else:
            bad = {name: int((~gradient.square().isfinite()).sum()) for name, gradient in seen.items()}
            left = sum(bad.values())
            means = self.means(name for name, count in bad.items() if not count)
            for name, mean in means.items():
                mean.lerp_(seen[name], 1 - self._directed.momentum)
            along = _in_pieces({name: partial(self._directed.directions[name], mean) for name, mean in means.items()})
            moved = {name: direction * -self.rate(name, step) for name, direction in along.items()}
        for name, change in self._through_maps(moved).items():
            self.model.get_parameter(name).add_(change)
        return left

    def rate(self, name: str, step: int) -> float:
        """The learning rate of a parameter at ``step``; 0 while it is kept."""
        group = self.groups[name]
        if not group.moves(step):
            return 0.0
        return self._slowed[name] * group.rate.at(self._progress(step, group.begins))

    def slow(self, prefixes: tuple[str, ...], factor: float) -> None:
        """From now on the rates of parameters whose names begin so are ``factor`` times those of their groups.

        Not part of :meth:`state`: who asks for it asks again in a resumed run.
        """
        self._slowed |= {name: factor for name in self._slowed if name.startswith(prefixes)}

    def scale(self, scalings: Mapping[str, Callable[[Tensor], Tensor]], directed: Directed | None = None) -> None:
        """From now on Adam sees gradients of these parameters, no columns, through a linear map that is its own
        transpose, and its steps go through it too; moments are of what it sees. What is mixed with a gradient that is
        not finite is not moved either. Threads share the maps, which may not ask for pieces of their own.

        With ``directed``, which has a direction for each of them, its steps are taken instead of Adam's, and second
        moments stay as they are. A parameter does not move where any number of its gradient is not finite, or too large
        to be squared.

        Not part of :meth:`state`, as :meth:`slow` is not.
        """
        self._scalings, self._directed = scalings, directed

    def means(self, names: Iterable[str]) -> dict[str, Tensor]:
        """Running means of these parameters' gradients, not copied."""
        return {name: self._mean[name] for name in names}

    @property
    def scales(self) -> bool:
        """Whether any parameter has such a map."""
        return bool(self._scalings)

    def begin_anew(self) -> None:
        """Forget what was stepped so far: moments of zero for the parameters as they are now, of whatever shape, and no
        maps."""
        self._scalings, self._directed = {}, None
        for name, parameter in self._parameters():
            self._mean[name], self._square[name] = torch.zeros_like(parameter), torch.zeros_like(parameter)
        self._updates = dict.fromkeys(self.groups, 0)

    def extend(self, added: int) -> None:
        """The run has ``added`` more steps behind its last. In them rates run their course once more, so that something
        is learned and settles again; moments go on."""
        self._ends.append(self._ends[-1] + added)

    def _progress(self, step: int, begins: int) -> float:
        """Share of the run, or of the part that was added to it, behind ``step``; of rates that count from ``begins``.

        What is added is lit from its first step.
        """
        added = [(a, b) for a, b in pairwise(self._ends) if a < step]
        if len(added) <= 1:
            return (step - begins) / max(self.steps - begins, 1)
        first, last = added[-1]
        return (step - first) / (last - first)

    @torch.no_grad()
    def edit_rows(self, rows: Int[Tensor, "K"], added: Gaussians | None = None) -> None:
        """The table becomes these ``rows``, in this order; moments follow, those of new rows start at zero.

        Numbers from the table's length on are rows of ``added``. One gather a tensor: two would be half of a round of
        density control.
        """
        new = {} if added is None else added.columns()
        columns = self.model.columns
        assert isinstance(columns, nn.ParameterDict)
        for column, old in list(columns.items()):
            tail = new[column] if new else old[:0]
            name = COLUMNS + column
            columns[column] = nn.Parameter(torch.cat([old.detach(), tail])[rows])
            for moments in (self._mean, self._square):
                moments[name] = torch.cat([moments[name], torch.zeros_like(tail)])[rows]

    @torch.no_grad()
    def replace(self, name: str, value: Tensor) -> None:
        """Give a parameter a new value, of any shape; its moments start at zero."""
        owner, _, attribute = name.rpartition(".")
        module = self.model.get_submodule(owner)
        parameter = nn.Parameter(value.detach().clone())
        if isinstance(module, nn.ParameterDict):
            module[attribute] = parameter
        else:
            setattr(module, attribute, parameter)
        self._mean[name], self._square[name] = torch.zeros_like(parameter), torch.zeros_like(parameter)
        self._scalings = {other: scaling for other, scaling in self._scalings.items() if other != name}

    def state(self) -> dict[str, Tensor]:
        """Everything that a resumed run needs, by name."""
        return self.moments | {"updates": torch.tensor(list(self._updates.values()), dtype=torch.int64)}

    @property
    def moments(self) -> dict[str, Tensor]:
        """Means of gradients and of their squares: ``mean.columns.means``, ..."""
        mean = {f"mean.{name}": tensor for name, tensor in self._mean.items()}
        return mean | {f"square.{name}": tensor for name, tensor in self._square.items()}

    def restore(self, state: Mapping[str, Tensor]) -> None:
        """Inverse of :meth:`state`, on a model whose parameters have been restored already."""
        for name in self.groups:
            device = self._mean[name].device
            self._mean[name] = state[f"mean.{name}"].to(device, copy=True)
            self._square[name] = state[f"square.{name}"].to(device, copy=True)
        self._updates = dict(zip(self._updates, state["updates"].tolist(), strict=True))

    def _through_maps(self, tensors: Mapping[str, Tensor]) -> dict[str, Tensor]:
        """Each by its own map."""
        return _in_pieces({name: partial(self._scalings[name], tensor) for name, tensor in tensors.items()})

    def _parameters(self) -> Iterator[tuple[str, Tensor]]:
        """What the model holds under each name now. Raises KeyError for a name that it has lost."""
        for owner, attributes in self._attributes.items():
            held: Any = self.model
            for part in owner:  # torch's own way there takes as long as the update of a light field
                held = held._modules[part]
            for name, attribute in attributes:
                yield name, held._parameters[attribute]


def _in_pieces(wanted: "Mapping[str, partial[Tensor]]") -> dict[str, Tensor]:
    """What each returns for its tensor, some at once."""
    if not wanted:
        return {}
    device = next(iter(wanted.values())).args[0].device
    return dict(zip(wanted, each_of(list(wanted.values()), device), strict=True))


def _group_of(name: str, groups: Mapping[str, Adam]) -> Adam:
    for pattern, group in groups.items():
        if fnmatchcase(name, pattern):
            return group
    raise RecipeError(f"no learning rate for parameter {name!r}; the recipe knows: {', '.join(groups)}")
