"""tensorf: a volume of density and appearance, both as sums of planes times lines.

Chen, Xu, Geiger, Yu, Su: TensoRF: Tensorial Radiance Fields, ECCV 2022. Written from the paper and its supplement; the
numbers are those of its published settings. What differs: docs/methods/tensorf.md.
"""

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, ClassVar, Literal

from ringlight.errors import RecipeError
from ringlight.fit.rates import Adam, Part, Rate, RateInParts, check_rates

if TYPE_CHECKING:
    from jaxtyping import Float
    from torch import Tensor

    from ringlight.core.scene import Scene
    from ringlight.fit.train import Training
    from ringlight.rasterize.contract import Rasterizer
    from ringlight.volume.contract import Sides
    from ringlight.volume.model import VolumeModel

PAPER_STEPS = 30_000
"""Length of the paper's run, of which the schedules are shares."""

REFINED = (2000, 3000, 4000, 5500, 7000)
"""Steps of the paper's run after which the grid is refined."""

EMPTIED = (2000, 4000)
"""Steps of the paper's run after which empty space is found."""

BETAS, EPSILON = (0.9, 0.99), 1e-8
"""Adam's."""

LAST_RATE = 0.1
"""Share of a learning rate that is left after a whole run, if nothing sets it back."""

LARGEST_SIDE, MOST_COMPONENTS, MOST_UNITS, MOST_RAYS = 4096, 4096, 1024, 1 << 20
"""Beyond these a number is a mistake."""


@dataclass(frozen=True)
class TensorfRecipe:
    """TensoRF (Chen et al. 2022): density and appearance as planes times lines, and a small network."""

    steps: int = 15_000
    """Training steps of a lot of rays each; the paper's schedules scale with them."""
    rays: int = 4096
    """Rays of a step, drawn from all photographs."""
    decomposition: Literal["vm", "cp"] = "vm"
    """Factors of the grids: planes times lines (VM-192), or three lines (CP-384: a twentieth of the bytes)."""
    density_components: int | None = None
    """Components of density: by default 16 of each of three planes, or 96 of three lines."""
    appearance_components: int | None = None
    """Components of appearance: by default 48 of each of three planes, or 288 of three lines."""
    features: int = 27
    """Numbers that the components of appearance are mixed to, for the network."""
    hidden: int = 128
    """Units of both hidden layers."""
    first_side: int = 128
    """The grid begins with as many voxels as a cube of this side."""
    last_side: int | None = None
    """The grid ends with as many voxels as a cube of this side: by default 300, or 500 of three lines."""
    bounds: tuple[float, float, float, float, float, float] | None = None
    """Lowest and highest corner of the box that the volume covers, world units: x y z x y z. By default that of the
    masks, or of an even background, or of the points, or what all cameras look at; the run says which."""
    carve: bool = True
    """Begin with what masks, or an even background, leave of the box; without, as in the paper, with all of it."""
    rate: float = 0.02
    """Learning rate of planes and lines; it falls to a tenth over a run, and is set back when the grid is refined."""
    network_rate: float = 1e-3
    """Learning rate of the network and of the matrix that mixes components."""
    l1: float | None = None
    """Weight of the mean absolute value of density's factors until empty space is found, then half of it. By default
    8e-5 for planes; 1e-5 all along for three lines."""
    tv_density: float = 0.0
    """Weight of the total variation of density's planes. The paper has 0.1, and l1 0, for real photographs."""
    tv_appearance: float = 0.0
    """Weight of the total variation of appearance's planes; 0.01 there."""

    most: ClassVar[None] = None
    random_points: ClassVar[int] = 0
    start: ClassVar[None] = None
    packings: ClassVar[tuple[tuple[str, str], ...]] = ()

    def __post_init__(self) -> None:
        self._refuse_counts()
        if self.decomposition == "cp" and (self.tv_density or self.tv_appearance):
            raise RecipeError("tv_density or tv_appearance is given, and three lines have no planes; leave both away")
        check_rates(rate=self.rate, network_rate=self.network_rate)
        for name in ("l1", "tv_density", "tv_appearance"):
            if not 0 <= (getattr(self, name) or 0.0) < math.inf:
                raise RecipeError(f"{name} is {getattr(self, name):g}; give 0 (none) or more")
        if self.bounds is not None:
            low, high = self.bounds[:3], self.bounds[3:]
            if not all(math.isfinite(a) and math.isfinite(b) and a < b for a, b in zip(low, high, strict=True)):
                raise RecipeError(
                    f"bounds are {' '.join(f'{v:g}' for v in self.bounds)}; give the lowest corner, x y z, then the "
                    "highest, each of its numbers above the lowest corner's"
                )

    def _refuse_counts(self) -> None:
        bounds = {
            "rays": (1, MOST_RAYS),
            "density_components": (1, MOST_COMPONENTS),
            "appearance_components": (1, MOST_COMPONENTS),
            "features": (1, MOST_UNITS),
            "hidden": (1, MOST_UNITS),
            "first_side": (2, LARGEST_SIDE),
            "last_side": (2, LARGEST_SIDE),
        }
        for name, (least, most) in bounds.items():
            value = getattr(self, name)
            if value is not None and not least <= value <= most:
                raise RecipeError(f"{name} is {value}; give {least} to {most}")
        if self.final_side < self.first_side:
            raise RecipeError(f"last_side is {self.final_side}, below first_side, {self.first_side}; give as much")

    @property
    def components(self) -> tuple[int, int]:
        """Of density and appearance: of each plane, or of all lines together."""
        density, appearance = (16, 48) if self.decomposition == "vm" else (96, 288)
        return self.density_components or density, self.appearance_components or appearance

    @property
    def final_side(self) -> int:
        """Of a cube with as many voxels as the grid at the end."""
        return self.last_side or (300 if self.decomposition == "vm" else 500)

    def at_share(self, steps: tuple[int, ...]) -> tuple[int, ...]:
        """Steps of the paper's run as steps of this one."""
        return tuple(max(round(step * self.steps / PAPER_STEPS), 1) for step in steps)

    def settled(self, scene: "Scene", rasterize: "Rasterizer", seed: int) -> "tuple[TensorfRecipe, str | None]":
        """With the box that it covers, and where that is from."""
        if self.bounds is not None:
            return self, None
        from ringlight.methods.volume_box import in_words, volume_box

        chosen = volume_box(scene)
        a, b, c, d, e, f = chosen.box.flatten().tolist()
        return replace(self, bounds=(a, b, c, d, e, f)), in_words(chosen)

    def build(self, scene: "Scene", rasterize: "Rasterizer", seed: int) -> "Training":
        from ringlight.methods.volume_training import volume_training

        recipe, _ = self.settled(scene, rasterize, seed)
        return volume_training(recipe, scene, rasterize, seed)

    def model(self, box: "Float[Tensor, '2 3']", rasterize: "Rasterizer") -> "VolumeModel":
        from ringlight.volume.grids import sides_of

        return self.model_of(sides_of(box, self.first_side**3), box)

    def model_of(self, sides: "Sides", box: "Float[Tensor, '2 3']", seed: int = 0) -> "VolumeModel":
        """With a grid of so many nodes, drawn by ``seed``."""
        from ringlight.core.randomness import generator
        from ringlight.volume.factored import FactoredField
        from ringlight.volume.model import VolumeModel
        from ringlight.volume.shading import FeatureShading

        drawn = generator(seed, 0, "volume")
        field = FactoredField(self.decomposition, sides, self.components, self.features, drawn)
        return VolumeModel(field, FeatureShading(self.features, self.hidden, drawn), box)

    def groups(self) -> dict[str, Adam]:
        """Adam's, by parameter name."""
        return {
            "field.*_factors.*": Adam(self._rate(self.rate), BETAS, EPSILON),
            "*": Adam(self._rate(self.network_rate), BETAS, EPSILON),
        }

    def _rate(self, first: float) -> Rate | RateInParts:
        """Falling, and set back after each refinement."""
        ends = [*(step / self.steps for step in self.at_share(REFINED)), 1.0]
        begins = [0.0, *ends[:-1]]
        parts = [
            Part(end, Rate(first, first * LAST_RATE ** (end - begin)))
            for begin, end in zip(begins, ends, strict=True)
            if end > begin
        ]
        return RateInParts(tuple(parts))

    @property
    def l1_weights(self) -> tuple[float, float]:
        """Until empty space is found, and then."""
        if self.decomposition == "cp":
            weight = 1e-5 if self.l1 is None else self.l1
            return weight, weight
        first = 8e-5 if self.l1 is None else self.l1
        return first, first / 2

    def ending_with(self, most: int | None, dropping: bool = True) -> "TensorfRecipe":
        """Itself: its grid has the side that it says."""
        return self

    def never_above(self, most: int) -> "TensorfRecipe":
        """Itself likewise."""
        return self

    def without_effect(self) -> dict[str, str]:
        """Nothing."""
        return {}

    def as_stored(self, shapes: Mapping[str, tuple[int, ...]]) -> "TensorfRecipe":
        """With a model of the resolution, and of the bits of what is not empty, that a file has."""
        lines = [shapes.get(f"field.density_factors.lines.{k}", (0,))[0] for k in range(3)]
        x, y, z = lines if self.decomposition == "cp" else reversed(lines)
        bits = shapes.get("occupied", ())
        if min(x, y, z) < 2 or len(bits) != 3:
            return self
        return _Stored(**vars(self), sides=(x, y, z), bits=(bits[0], bits[1], bits[2]))


@dataclass(frozen=True)
class _Stored(TensorfRecipe):
    """The recipe of a file, whose training is over."""

    sides: tuple[int, int, int] = (2, 2, 2)
    bits: tuple[int, int, int] = (1, 1, 1)

    def model(self, box: "Float[Tensor, '2 3']", rasterize: "Rasterizer") -> "VolumeModel":
        import torch

        model = self.model_of(self.sides, box)
        model.occupied = torch.zeros(self.bits, dtype=torch.uint8)
        return model
