"""Adam by parameter name, and the only code that knows that moments follow rows.

Every change of a parameter's shape goes through the verbs here (``edit_rows``, ``replace``), because resizing a
parameter without its moments is the classic bug of this field.
"""

from collections.abc import Mapping
from fnmatch import fnmatchcase

import torch
from jaxtyping import Int
from torch import Tensor, nn

from ringlight import _kernels
from ringlight.core.gaussians import Gaussians
from ringlight.errors import RecipeError
from ringlight.fit.rates import Adam
from ringlight.models.splats import COLUMNS_PREFIX


class Optimizer:
    """Steps each parameter by the first group whose pattern matches its name.

    Raises RecipeError for a parameter that no pattern matches: nothing is silently frozen.
    """

    def __init__(self, model: nn.Module, groups: Mapping[str, Adam], steps: int):
        self.model, self.steps = model, steps
        self.groups = {name: _group_of(name, groups) for name, _ in model.named_parameters()}
        self._mean = {name: torch.zeros_like(p) for name, p in model.named_parameters()}
        self._square = {name: torch.zeros_like(p) for name, p in model.named_parameters()}
        self._updates = dict.fromkeys(self.groups, 0)

    @torch.no_grad()
    def step(self, step: int) -> None:
        """Update every parameter that has a gradient, and drop the gradients."""
        for name, parameter in self.model.named_parameters():
            if parameter.grad is None:
                continue
            group = self.groups[name]
            self._updates[name] += 1
            progress = (step - group.begins) / max(self.steps - group.begins, 1)
            adam_(
                parameter, parameter.grad, self._mean[name], self._square[name],
                group, group.rate.at(progress), self._updates[name],
            )  # fmt: skip
            parameter.grad = None

    @torch.no_grad()
    def edit_rows(self, keep: Int[Tensor, "K"], added: Gaussians | None = None) -> None:
        """Keep these rows, in this order, then append ``added``; moments follow, those of new rows start at zero."""
        new = {} if added is None else added.columns()
        columns = self.model.columns
        assert isinstance(columns, nn.ParameterDict)
        for column, old in list(columns.items()):
            tail = new[column] if new else old[:0]
            name = COLUMNS_PREFIX + column
            columns[column] = nn.Parameter(torch.cat([old.detach()[keep], tail]))
            for moments in (self._mean, self._square):
                moments[name] = torch.cat([moments[name][keep], torch.zeros_like(tail)])

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

    def state(self) -> dict[str, Tensor]:
        """Everything that a resumed run needs, by name."""
        updates = torch.tensor(list(self._updates.values()), dtype=torch.int64)
        mean = {f"mean.{name}": tensor for name, tensor in self._mean.items()}
        return mean | {f"square.{name}": tensor for name, tensor in self._square.items()} | {"updates": updates}

    def restore(self, state: Mapping[str, Tensor]) -> None:
        """Inverse of :meth:`state`, on a model whose parameters have been restored already."""
        for name in self.groups:
            self._mean[name] = state[f"mean.{name}"].clone()
            self._square[name] = state[f"square.{name}"].clone()
        self._updates = dict(zip(self._updates, state["updates"].tolist(), strict=True))


def adam_(
    value: Tensor, gradient: Tensor, mean: Tensor, square: Tensor, group: Adam, rate: float, updates: int
) -> None:
    """One update in place, the ``updates``-th of this parameter (Kingma & Ba 2015, algorithm 1)."""
    if value.device.type == "cpu" and value.dtype == torch.float32 and value.is_contiguous():
        beta1, beta2 = group.betas
        gradient = gradient.contiguous()
        _kernels.adam(
            _flat(value), _flat(gradient), _flat(mean), _flat(square), rate, beta1, beta2, group.epsilon, updates
        )
        # The kernel writes behind torch's back: a graph that still needs the old values must notice.
        torch.autograd.graph.increment_version(value)
    else:
        adam_reference_(value, gradient, mean, square, group, rate, updates)


def adam_reference_(
    value: Tensor, gradient: Tensor, mean: Tensor, square: Tensor, group: Adam, rate: float, updates: int
) -> None:
    """The slow twin of the kernel, for any device and type."""
    beta1, beta2 = group.betas
    mean.lerp_(gradient, 1 - beta1)
    square.mul_(beta2).addcmul_(gradient, gradient, value=1 - beta2)
    denominator = (square / (1 - beta2**updates)).sqrt_().add_(group.epsilon)
    value.addcdiv_(mean, denominator, value=-rate / (1 - beta1**updates))


def _flat(tensor: Tensor) -> Tensor:
    return tensor.detach().view(-1)


def _group_of(name: str, groups: Mapping[str, Adam]) -> Adam:
    for pattern, group in groups.items():
        if fnmatchcase(name, pattern):
            return group
    raise RecipeError(f"no learning rate for parameter {name!r}; the recipe knows: {', '.join(groups)}")
