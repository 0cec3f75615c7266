"""What may be set of putt, and the ranks and the grid that follow from it."""

import math
from dataclasses import dataclass
from typing import ClassVar

from ringlight.core.kernel_limits import TRAIN_MOST_LEVELS
from ringlight.core.later import later
from ringlight.errors import RecipeError
from ringlight.fit.rates import check_rates
from ringlight.methods.averaging import AVERAGED
from ringlight.methods.long_axes import grid_in_words, long_axes
from ringlight.methods.putt_rates import trains_rate
from ringlight.methods.putt_schedule import EARLY, EMPTY_AT, LAST_DOUBLING, LATEST_DOUBLING
from ringlight.methods.putt_sizes import (
    FEWEST_RANKS,
    MOST_RANKS,
    PAPER_RANKS,
    PAPER_SIZES,
    TrainSizes,
    levels_of,
)
from ringlight.methods.volume_network import NETWORK_RATE
from ringlight.methods.volume_recipe import BY_ERROR, MOST_RAYS, MOST_UNITS, Bounds, VolumeRecipe

ALL_GRADIENTS = 1.0
"""Products of eight matrices feel the noise of drawn gradients (docs/experiments/putt.md)."""

SMALLEST_SIDE, LARGEST_SIDE = 4, 1 << TRAIN_MOST_LEVELS
"""One level for blocks and one for nodes in them; and what kernels take."""

OF_SCALING = ("scaled_after", "orthogonal")
"""Settings that decide nothing where steps are not scaled."""

SCALED = 0.6
"""After the last doubling it gained 0.1 to 0.2 dB on held-out views, from the first step on it lost 3.3 on one scene;
0.85 gained nothing (docs/experiments/putt.md)."""

HIDDEN = 256
"""Held-out views of three scenes gain 0.35 dB beside 128 units at a quarter of their size, for a quarter to a third
more core seconds (docs/experiments/putt.md)."""

TV_APPEARANCE = 1.5e-3
"""Held-out views of lego_400 gain 0.15 to 0.2 dB after 3,000 steps, and those of chair_400 nothing; thrice as much
gained no more, by a script (docs/experiments/putt.md)."""


@dataclass(frozen=True)
class PuttSettings(VolumeRecipe):
    """Base of putt's recipe: settings that are checked, and what is known before there is a model."""

    steps: int = 15_000
    """Training steps of a lot of rays each; the paper's schedules scale with them."""
    rays: int = 4096
    """Rays of a step, drawn from all photographs."""
    size: float | None = None
    """Megabytes of the model, which decide both ranks: the largest multiples of eight, in about the paper's
    proportion. By default the paper's ranks."""
    density_rank: int | None = None
    """Largest rank of density's train: by default the paper's, 200."""
    appearance_rank: int | None = None
    """Largest rank of appearance's train: by default the paper's, 280."""
    features: int = 27
    """Numbers that the train of appearance gives the network."""
    hidden: int = HIDDEN
    """Units of both hidden layers; 128 in the paper."""
    coarsest: int = 16
    """Nodes along each axis at the start, a power of two; along long ones twice as many."""
    finest: int = 256
    """Nodes along each axis at the end, a power of two; along long ones twice as many."""
    even_voxels: bool = later(False, now=True)
    """Axes along which the box is at least one and a half times as long as along its shortest have twice as many nodes,
    if those are at most 1,024. In the paper all axes have the same."""
    bounds: Bounds | None = None
    """Lowest and highest corner of the box that the volume covers, world units: x y z x y z. By default that of the
    masks, or of an even background, or of the points, or what all cameras look at; the run says which."""
    carve: bool = True
    """Begin with what masks, or an even background, leave of the box; without, as in the paper, with all of it."""
    gradient_share: float = ALL_GRADIENTS
    """At most this share of a step's samples that have a gradient hand it on, of density and of colour each, drawn by
    importance, which keeps the mean; 1, as in the papers: all do."""
    empty_at: tuple[float, float] = later(EARLY, now=EMPTY_AT)
    """Shares of a run after which empty space is found: after the first, cells that are all but empty are skipped, and
    after the second so are rays that meet no others. Looks before the last doubling may take for empty what the coarser
    grid has not learned."""
    last_doubling: float = later(0.0, now=LAST_DOUBLING)
    """The grid doubles for the last time after this share of a run, at most 0.75, or where the paper has it if that
    is later. While it is coarse a step takes less time."""
    rate: float | None = None
    """Learning rate of the trains; it falls to a fifth over a run, and is set back when the grid is refined. By default
    the paper's, 8e-4, times the root of how many times shorter than its 80,000 steps the run is, and twice that as far
    as 0.008; at most 0.03."""
    network_rate: float = NETWORK_RATE
    """Learning rate of the network, which falls likewise; 1e-3 in TensoRF."""
    network_warm_up: float | None = later(0.0, now=None)
    """Share of a run over which the network's rate rises to its start, from a tenth of it: by default 200 steps, in
    short runs a fifteenth of them; 0, as in the paper: it does not. While nothing is opaque yet all that the network
    can learn is that the subject is darker than a white background; a wide or fast one then shows black, perhaps for
    good."""
    l1: float = 1e-5
    """Weight of the mean absolute value of the cores of density's train."""
    tv_appearance: float = later(0.0, now=TV_APPEARANCE)
    """Weight of the total variation of appearance: the mean absolute difference of features one node apart, at drawn
    places that rays do not skip; 0, as in the paper: none."""
    decay: float = later(0.0)
    """Weight decay: share of the trains' rate by which the cores of all levels that are reached shrink before each
    step; 0, as in the paper: none do."""
    scaled: float = later(0.0, now=SCALED)
    """How far steps of a core are scaled by what the other cores make of its indices, from 0 (Adam as it is) to below
    1: the share of their Gram matrices beside one whose eigenvalues all are their mean."""
    scaled_after: int = later(0, now=TRAIN_MOST_LEVELS)
    """Doublings before steps are scaled, or all of them where there are fewer; 0: steps are scaled from the start.
    While the grid is coarse, scaled steps are too short: what lies in the wrong place then stays there."""
    orthogonal: bool = later(False, now=True)
    """Steps that are scaled go along near-orthogonal matrices, by which all that a mean gradient tells counts about as
    much (Muon, Jordan et al. 2024); without, and where none are scaled, as Adam has them."""
    by_error: float = later(0.0, now=BY_ERROR)
    """Share of a step's rays that are drawn by the errors of those before them, which are told by blocks of 4 x 4
    pixels, and weighted so that the loss keeps its mean. 0, as in the papers: all are drawn evenly."""
    average: float = later(0.0, now=AVERAGED)
    """Share of a run, its last: the kept model is the mean of the models after each of its steps. 0 keeps the last one;
    rates fall to 0.07 then, and to 0.01 over the last fifth."""

    paper_steps: ClassVar[int] = 30_000  # TensoRF's, whose steps PuTT takes over in runs of 80,000

    def __post_init__(self) -> None:
        ranks = (FEWEST_RANKS, MOST_RANKS)
        self.refuse_counts(
            rays=(1, MOST_RAYS),
            density_rank=ranks,
            appearance_rank=ranks,
            features=(1, MOST_UNITS),
            hidden=(1, MOST_UNITS),
            coarsest=(SMALLEST_SIDE, LARGEST_SIDE),
            finest=(SMALLEST_SIDE, LARGEST_SIDE),
            scaled_after=(0, TRAIN_MOST_LEVELS),
        )
        for name in ("coarsest", "finest"):
            side = getattr(self, name)
            if side & (side - 1):
                below = 1 << (side.bit_length() - 1)
                raise RecipeError(f"{name} is {side}; give a power of two, such as {below} or {2 * below}")
        if self.finest < self.coarsest:
            raise RecipeError(f"finest is {self.finest}, below coarsest, {self.coarsest}; give as much")
        check_rates(rate=self.first_rate, network_rate=self.network_rate)
        self._refuse_weights()
        self.refuse_bounds()
        self.refuse_shares()
        if not 0 < self.empty_at[0] < self.empty_at[1] < 1:
            first, second = (f"{share:g}" for share in self.empty_at)
            raise RecipeError(f"empty_at is {first} {second}; give two shares of a run that rise, such as 0.45 0.55")
        if not 0 <= self.last_doubling <= LATEST_DOUBLING:
            raise RecipeError(f"last_doubling is {self.last_doubling:g}; give 0 (the paper's) to {LATEST_DOUBLING:g}")
        if not 0 <= self.scaled < 1:
            raise RecipeError(f"scaled is {self.scaled:g}; give 0 (Adam as it is) to below 1")
        self._refuse_size()

    def without_effect(self) -> dict[str, str]:
        """See :meth:`ringlight.methods.recipe.Recipe.without_effect`."""
        return {} if self.scaled else dict.fromkeys(OF_SCALING, "--scaled is 0")

    def _refuse_weights(self) -> None:
        for name in ("l1", "tv_appearance"):
            weight = getattr(self, name)
            if not 0 <= weight < math.inf:
                raise RecipeError(f"{name} is {weight:g}; give 0 (none) or more")
        if not 0 <= self.decay < math.inf:
            raise RecipeError(f"decay is {self.decay:g}; give 0 (none) or more")
        if self.decay * self.first_rate >= 1:
            most = 1 / self.first_rate
            raise RecipeError(f"decay is {self.decay:g}; give less than 1 / rate, {most:g}, which leaves only zeros")

    def _refuse_size(self) -> None:
        if self.size is None:
            return
        given = next((n for n in ("density_rank", "appearance_rank") if getattr(self, n) is not None), None)
        if given is not None:
            raise RecipeError(f"size and {given} are given, and both decide the rank; leave one away")
        least, most = self.sizes.range
        if not least <= self.size <= most:
            raise RecipeError(
                f"size is {self.size:g}; trains of {self.in_words(self.finest)} and their network take {least:g} to "
                f"{most:g} megabytes; give one of these, such as {min(PAPER_SIZES[1], most):g}"
            )

    @property
    def ranks(self) -> tuple[int, int]:
        """Largest ranks of density and appearance."""
        if self.size is None:
            return self.density_rank or PAPER_RANKS[0], self.appearance_rank or PAPER_RANKS[1]
        return self.sizes.ranks_within(self.size)

    @property
    def sizes(self) -> TrainSizes:
        """Of both trains at the end of the run, by any ranks."""
        return TrainSizes(self.features, self.hidden, levels_of(self.finest), len(self.long_axes))

    @property
    def long_axes(self) -> tuple[int, ...]:
        """Those with twice the nodes, of x, y and z as 0, 1 and 2; none while the box is not known."""
        return self.long_axes_up_to(self.finest)

    def long_axes_up_to(self, finest: int) -> tuple[int, ...]:
        """:attr:`long_axes` of the same recipe with another ``finest``: a grid as fine as kernels take has none."""
        if self.bounds is None or not self.even_voxels or finest == LARGEST_SIDE:
            return ()
        return long_axes(self.bounds)

    @property
    def final_side(self) -> int:
        return self.finest

    @property
    def smaller_sides(self) -> tuple[int, ...]:
        return tuple(1 << level for level in range(levels_of(self.finest), levels_of(self.coarsest) - 1, -1))

    def finer(self, nodes: tuple[int, int, int]) -> float:
        return self.finest / min(nodes)

    def in_words(self, side: int) -> str:
        return grid_in_words(side, self.long_axes_up_to(side))

    @property
    def longest_side(self) -> int:
        return self.finest << bool(self.long_axes)

    def remedy(self, side: int) -> str:
        return f"give --finest {side} or less, or smaller ranks"

    @property
    def lighter(self) -> str:
        return "give a smaller --density-rank and --appearance-rank, or a smaller --coarsest and --finest"

    @property
    def first_rate(self) -> float:
        """Of the trains."""
        return trains_rate(self.steps) if self.rate is None else self.rate
