"""What recipes of volumes have in common: a box, rays of all photographs, a grid that is refined while it trains."""

import math
from abc import ABC, abstractmethod
from array import array
from collections.abc import Mapping
from dataclasses import Field, fields, replace
from typing import TYPE_CHECKING, Any, ClassVar, TypeVar

from ringlight.errors import RecipeError
from ringlight.fit.rates import Adam, Part, Rate, RateInParts
from ringlight.methods.averaging import check_average, first_averaged
from ringlight.methods.volume_network import rising_share

if TYPE_CHECKING:
    from jaxtyping import Float
    from torch import Tensor

    from ringlight.core.scene import Scene
    from ringlight.fit.optimizer import Optimizer
    from ringlight.fit.regularizers.contract import Regularizer
    from ringlight.fit.strategies.contract import Strategy
    from ringlight.fit.train import Training
    from ringlight.methods.recipe import Recipe
    from ringlight.rasterize.contract import Rasterizer
    from ringlight.volume.model import VolumeModel

BETAS, EPSILON = (0.9, 0.99), 1e-8
"""Adam's, of TensoRF and of what is built on it."""

BY_ERROR = 0.7
"""Rays that are wrong by more make a lot's gradient less noisy; three tenths are drawn evenly, so that none counts
more than 3.4 times (docs/experiments/putt.md)."""

MOST_UNITS, MOST_RAYS = 1024, 1 << 20
"""Beyond these a number is a mistake."""

REFERENCE = "reference"
"""Name of the rasterizer that is all torch."""

OF_ANY_SAMPLE = 30
"""Numbers, rounded up from benchmarks/volume_memory.py: place, distance, weight, light that is left, slope, colour,
gradients, and which of them are drawn."""

Bounds = tuple[float, float, float, float, float, float]
"""Lowest and highest corner of a box, world units: x y z x y z."""

Volume = TypeVar("Volume", bound="VolumeRecipe")


class VolumeRecipe(ABC):
    """Base of recipes whose model is a :class:`ringlight.volume.model.VolumeModel`. The paper's schedules scale with
    ``steps``."""

    __dataclass_fields__: ClassVar[dict[str, Field[Any]]]
    paper_steps: ClassVar[int]
    """Length of the paper's run."""
    most: ClassVar[None] = None
    random_points: ClassVar[int] = 0
    start: ClassVar[None] = None
    packings: ClassVar[tuple[tuple[str, str], ...]] = ()
    steps: int
    rays: int
    bounds: Bounds | None
    carve: bool
    gradient_share: float
    network_warm_up: float | None
    by_error: float
    """Share of the rays that are drawn by error."""
    average: float
    """Share of a run, its last, over whose models the one that is kept is the mean."""

    @property
    @abstractmethod
    def emptied(self) -> tuple[int, ...]:
        """Steps after which empty space is found."""

    @property
    @abstractmethod
    def refined(self) -> Mapping[int, float]:
        """Steps after which the grid is refined, and its voxels then."""

    @property
    @abstractmethod
    def final_side(self) -> int:
        """Of the grid at the end, as it is asked for."""

    @property
    def longest_side(self) -> int:
        """Nodes along the axis with the most at the end, or about as many."""
        return self.final_side

    def finer(self, nodes: tuple[int, int, int]) -> float:
        """How many times as fine the grid at the end is as one of so many nodes."""
        return self.final_side / math.prod(nodes) ** (1 / 3)

    def in_words(self, side: int) -> str:
        """A grid of such a side."""
        return f"{side} cubed"

    @property
    @abstractmethod
    def smaller_sides(self) -> tuple[int, ...]:
        """Sides that could be given instead, the largest first, down to that with which the grid begins."""

    @abstractmethod
    def remedy(self, side: int) -> str:
        """How to ask for this one."""

    @property
    @abstractmethod
    def lighter(self) -> str:
        """What to ask for where no side fits."""

    @abstractmethod
    def numbers_at(self, box: "Float[Tensor, '2 3']", side: int) -> int:
        """Roughly how many numbers a training keeps with a grid of such a side in this box."""

    @property
    @abstractmethod
    def numbers_of_sample(self) -> int:
        """Of a step, if it has a colour and hands its gradient on: the most that one takes."""

    @abstractmethod
    def groups(self) -> dict[str, Adam]:
        """Adam's, by parameter name."""

    @abstractmethod
    def first_model(self, box: "Float[Tensor, '2 3']", seed: int) -> "VolumeModel":
        """As it is before its first step."""

    @abstractmethod
    def terms(self, model: "VolumeModel", seed: int) -> "dict[str, Regularizer]":
        """What is added to the loss, by name; what is drawn for it is of this ``seed``."""

    def stepped_by(self, optimizer: "Optimizer", model: "VolumeModel") -> "tuple[Strategy, ...]":
        """What changes how the model's field is stepped; it comes after what changes the grid."""
        return ()

    @property
    def averaged_from(self) -> int | None:
        """First step whose model counts in the mean; None where the last is kept. The grid keeps its shape since."""
        reshaped = max((*self.emptied, *self.refined), default=0)
        return first_averaged(self.average, self.steps, reshaped)

    @property
    def network_rises_over(self) -> float:
        """Share of the run over which the network's rate rises."""
        return rising_share(self.network_warm_up, self.steps)

    def at_share(self, steps: tuple[float, ...]) -> tuple[int, ...]:
        """Steps of the paper's run as steps of this one."""
        return tuple(max(round(step * self.steps / self.paper_steps), 1) for step in steps)

    def falling(
        self, first: float, last_share: float, warm_up: float = 0.0, settled_share: float | None = None
    ) -> RateInParts:
        """A rate that falls to ``last_share`` of ``first`` over a run, and is set back after each refinement. Over
        ``warm_up``, a share of the run, it rises to its start, whatever is refined then. With a ``settled_share`` it
        falls faster over the last SETTLING of the run, to that share of ``first``."""
        begins = [0.0, *(step / self.steps for step in self.refined)]
        ends = [*begins[1:], 1.0]
        if settled_share is not None and begins[-1] < 1 - SETTLING:
            ends[-1] = 1 - SETTLING
        parts = [
            Part(end, Rate(first, first * last_share ** (end - begin)))
            for begin, end in zip(begins, ends, strict=True)
            if end > begin
        ]
        if settled_share is not None and ends[-1] < 1:
            parts.append(Part(1.0, Rate(parts[-1].rate.end, first * settled_share)))
        rising = [Part(warm_up, Rate(first * COLD, first))] if warm_up else []
        return RateInParts((*rising, *(part for part in parts if part.end > warm_up)))

    def settled(self: Volume, scene: "Scene", rasterize: "Rasterizer", seed: int) -> tuple[Volume, str | None]:
        """With the box that it covers, and where that is from."""
        if self.bounds is not None:
            return self, None
        from ringlight.methods.volume_box import in_words, volume_box

        chosen = volume_box(scene)
        a, b, c, d, e, f = chosen.box.flatten().tolist()
        return replace(self, bounds=(a, b, c, d, e, f)), in_words(chosen)

    def may_settle_on(self, other: "Recipe") -> bool:
        """Whether it is this one, with a box where this one has none."""
        if self.bounds is not None or not isinstance(other, type(self)):
            return self == other
        return all(
            getattr(self, each.name) == getattr(other, each.name) for each in fields(self) if each.name != "bounds"
        )

    def build(self, scene: "Scene", rasterize: "Rasterizer", seed: int) -> "Training":
        from ringlight.methods.volume_training import volume_training

        recipe, _ = self.settled(scene, rasterize, seed)
        return volume_training(recipe, scene, rasterize, seed)

    def model(self, box: "Float[Tensor, '2 3']", rasterize: "Rasterizer") -> "VolumeModel":
        return on_device(self.first_model(box, 0), rasterize)

    def ending_with(self: Volume, most: int | None, dropping: bool = True) -> Volume:
        """Itself: its grid has the side that it says."""
        return self

    def never_above(self: Volume, most: int) -> Volume:
        """Itself likewise."""
        return self

    def without_effect(self) -> dict[str, str]:
        """Nothing."""
        return {}

    def refuse_counts(self, **bounds: tuple[int, int]) -> None:
        """Raise RecipeError for a setting, if it is given, beyond the least and the most that it can be."""
        for name, (least, most) in bounds.items():
            value = self.__dict__[name]
            if value is not None and not least <= value <= most:
                raise RecipeError(f"{name} is {value}; give {least} to {most}")

    def refuse_shares(self) -> None:
        """Raise RecipeError for what is no share."""
        if not 0 < self.gradient_share <= 1:
            raise RecipeError(f"gradient_share is {self.gradient_share:g}; give more than 0, at most 1")
        if not 0 <= self.by_error < 1:
            raise RecipeError(f"by_error is {self.by_error:g}; give 0 (all rays are drawn evenly) to below 1")
        if self.network_warm_up is not None and not 0 <= self.network_warm_up < 1:
            raise RecipeError(f"network_warm_up is {self.network_warm_up:g}; give 0 (none) to below 1")
        check_average(self.average)

    def refuse_bounds(self) -> None:
        """Raise RecipeError for a box without an inside, as float32 has it."""
        if self.bounds is None:
            return
        corners = array("f", self.bounds)
        lengths = array("f", (high - low for low, high in zip(corners[:3], corners[3:], strict=True)))
        if not all(0 < length < math.inf for length in lengths):
            raise RecipeError(
                f"bounds are {' '.join(f'{v:.9g}' for v in self.bounds)}; give the lowest corner, x y z, then the "
                "highest, each of its numbers above the lowest corner's, and so far that float32 tells them apart"
            )


def on_device(model: "VolumeModel", rasterize: "Rasterizer") -> "VolumeModel":
    """The model where this back end's models lie, unless it is an outline, and marched in torch where this is the
    reference."""
    from ringlight.models.outline import is_outline

    model.in_torch = rasterize.name == REFERENCE
    return model if is_outline(model) else model.to(rasterize.device)


COLD = 0.1
"""Share of a rate at which it begins to rise."""

SETTLING = 0.2
"""Share of a run, its last, over which rates fall faster where a method wants that."""
