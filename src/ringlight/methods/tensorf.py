"""tensorf: a volume of density and appearance, both as sums of planes times lines.

Chen, Xu, Geiger, Yu, Su: TensoRF: Tensorial Radiance Fields, ECCV 2022. Written from the paper and its supplement; the
numbers are those of its published settings. What differs: docs/methods/tensorf.md.
"""

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, ClassVar, Literal

from ringlight.core.kernel_limits import VOLUME_MOST_COMPONENTS, VOLUME_MOST_NODES
from ringlight.core.later import later
from ringlight.errors import RecipeError
from ringlight.fit.rates import Adam, between, check_rates
from ringlight.methods.volume_network import NETWORK_RATE
from ringlight.methods.volume_recipe import (
    BETAS,
    EPSILON,
    MOST_RAYS,
    MOST_UNITS,
    OF_ANY_SAMPLE,
    Bounds,
    VolumeRecipe,
    on_device,
)

if TYPE_CHECKING:
    from jaxtyping import Float
    from torch import Tensor

    from ringlight.fit.regularizers.contract import Regularizer
    from ringlight.rasterize.contract import Rasterizer
    from ringlight.volume.contract import Sides
    from ringlight.volume.model import VolumeModel

PAPER_SIDES = (300, 500)
"""Of cubes with as many voxels as the paper's grids have at the end: of planes, and of three lines."""

SHORT_RUN, SHORT_RUN_SIDE, LONG_RUN = 3000, 200, 15_000
"""Runs of up to so many steps end with planes of such a side, those of LONG_RUN with the paper's."""

REFINED = (2000, 3000, 4000, 5500, 7000)
"""Steps of the paper's run after which the grid is refined."""

EMPTIED = (2000, 4000)
"""Steps of the paper's run after which empty space is found."""

LAST_RATE = 0.1
"""Share of a learning rate that is left after a whole run, if nothing sets it back."""

GRADIENT_SHARE = 0.5
"""A quarter of the samples with a colour hand on; this adds little variance (docs/methods/tensorf.md)."""

COPIES = 6
"""Of a grid while it trains: values, gradients, those of a regularizer, two moments, and one while it is refined."""


@dataclass(frozen=True)
class TensorfRecipe(VolumeRecipe):
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
    """The grid ends with as many voxels as a cube of this side: by default 200 in runs of up to 3,000 steps, 300 in
    those of 15,000 or more, and in between evenly in the logarithm of the steps; of three lines always 500."""
    bounds: Bounds | None = None
    """Lowest and highest corner of the box that the volume covers, world units: x y z x y z. By default that of the
    masks, or of an even background, or of the points, or what all cameras look at; the run says which."""
    carve: bool = True
    """Begin with what masks, or an even background, leave of the box; without, as in the paper, with all of it."""
    gradient_share: float = GRADIENT_SHARE
    """At most this share of a step's samples that have a gradient hand it on, of density and of colour each, drawn by
    importance, which keeps the mean; 1, as in the papers: all do."""
    rate: float = 0.02
    """Learning rate of planes and lines; it falls to a tenth over a run, and is set back when the grid is refined."""
    network_rate: float = NETWORK_RATE
    """Learning rate of the network and of the matrix that mixes components; 1e-3 in the paper."""
    network_warm_up: float | None = later(0.0, now=None)
    """Share of a run over which that rate rises to its start, from a tenth of it: by default 200 steps, in short runs a
    fifteenth of them; 0, as in the paper: it does not. A fast network without it can show black, for good."""
    l1: float | None = None
    """Weight of the mean absolute value of density's factors until empty space is found, then half of it. By default
    8e-5 for planes; 1e-5 all along for three lines."""
    tv_density: float = 0.0
    """Weight of the total variation of density's planes. The paper has 0.1, and l1 0, for real photographs."""
    tv_appearance: float = 0.0
    """Weight of the total variation of appearance's planes; 0.01 there."""
    by_error: float = later(0.0)
    """Share of a step's rays that are drawn by the errors of those before them, which are told by blocks of 4 x 4
    pixels, and weighted so that the loss keeps its mean. 0, as in the papers: all are drawn evenly."""
    average: float = later(0.0)
    """Share of a run, its last: the kept model is the mean of the models after each of its steps; 0 keeps the last."""

    paper_steps: ClassVar[int] = 30_000

    def __post_init__(self) -> None:
        if self.decomposition == "cp" and (self.tv_density or self.tv_appearance):
            raise RecipeError("tv_density or tv_appearance is given, and three lines have no planes; leave both away")
        check_rates(rate=self.rate, network_rate=self.network_rate)
        for name in ("l1", "tv_density", "tv_appearance"):
            if not 0 <= (getattr(self, name) or 0.0) < math.inf:
                raise RecipeError(f"{name} is {getattr(self, name):g}; give 0 (none) or more")
        self.refuse_bounds()
        self.refuse_shares()
        self.refuse_counts(
            rays=(1, MOST_RAYS),
            density_components=(1, VOLUME_MOST_COMPONENTS),
            appearance_components=(1, VOLUME_MOST_COMPONENTS),
            features=(1, MOST_UNITS),
            hidden=(1, MOST_UNITS),
            first_side=(2, VOLUME_MOST_NODES),
            last_side=(2, VOLUME_MOST_NODES),
        )
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
        if self.last_side is not None:
            return self.last_side
        if self.decomposition == "cp":
            return PAPER_SIDES[1]
        share = math.log(max(self.steps, 1) / SHORT_RUN) / math.log(LONG_RUN / SHORT_RUN)
        return round(between(float(SHORT_RUN_SIDE), float(PAPER_SIDES[0]), min(max(share, 0.0), 1.0)))

    @property
    def emptied(self) -> tuple[int, ...]:
        return tuple(dict.fromkeys(self.at_share(EMPTIED)))

    @property
    def refined(self) -> dict[int, float]:
        from ringlight.volume.grids import growing

        return dict(zip(self.at_share(REFINED), growing(self.first_side, self.final_side, len(REFINED)), strict=True))

    @property
    def smaller_sides(self) -> tuple[int, ...]:
        return tuple(range(self.final_side, self.first_side - 1, -1))

    def remedy(self, side: int) -> str:
        return f"give --last-side {side} or less"

    @property
    def lighter(self) -> str:
        return "give fewer --density-components and --appearance-components, or a smaller --first-side and --last-side"

    def numbers_at(self, box: "Float[Tensor, '2 3']", side: int) -> int:
        from ringlight.volume.grids import sides_of

        x, y, z = sides_of(box, side**3)
        nodes = x + y + z + (x * y + x * z + y * z if self.decomposition == "vm" else 0)
        return COPIES * sum(self.components) * nodes

    @property
    def numbers_of_sample(self) -> int:
        """With the gradient of each component of appearance, if it hands one on."""
        width = self.components[1] * (3 if self.decomposition == "vm" else 1)
        return OF_ANY_SAMPLE + round(self.gradient_share * width)

    def first_model(self, box: "Float[Tensor, '2 3']", seed: int) -> "VolumeModel":
        from ringlight.volume.grids import sides_of

        return self.model_of(sides_of(box, self.first_side**3), box, seed)

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
            "field.*_factors.*": Adam(self.falling(self.rate, LAST_RATE), BETAS, EPSILON),
            "*": Adam(self.falling(self.network_rate, LAST_RATE, self.network_rises_over), BETAS, EPSILON),
        }

    def terms(self, model: "VolumeModel", seed: int) -> "dict[str, Regularizer]":
        from ringlight.fit.regularizers.factor_size import FactorSize
        from ringlight.fit.regularizers.factor_variation import FactorVariation

        names = [name for name, _ in model.named_parameters()]
        terms: dict[str, Regularizer] = {}
        if any(self.l1_weights):
            density = [name for name in names if name.startswith("field.density_factors.")]
            terms["l1"] = FactorSize(lambda: density, *self.l1_weights, until=self.emptied[0])
        for of, weight in (("density", self.tv_density), ("appearance", self.tv_appearance)):
            if weight:
                planes = [name for name in names if name.startswith(f"field.{of}_factors.planes.")]
                terms[f"{of} variation"] = FactorVariation(planes, weight, self.steps, LAST_RATE)
        return terms

    @property
    def l1_weights(self) -> tuple[float, float]:
        """Until empty space is found, and then."""
        lines = self.decomposition == "cp"
        first = (1e-5 if lines else 8e-5) if self.l1 is None else self.l1
        return first, first if lines else first / 2

    def as_stored(self, shapes: Mapping[str, tuple[int, ...]]) -> "TensorfRecipe":
        """With a model of the resolution, and of the bits of what is not empty, that a file has."""
        lines = [(*shapes.get(f"field.density_factors.lines.{k}", ()), 0)[0] for k in range(3)]
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
        return on_device(model, rasterize)
