"""putt: a volume of density and appearance, as two quantised tensor trains that go from coarse to fine.

Loeschcke, Wang, Leth-Espensen, Belongie, Kastoryano, Benaim: Coarse-To-Fine Tensor Trains for Compact Visual
Representations, ICML 2024. The numbers, most of them in ``putt_settings.py``, are those of its published settings. What
differs: docs/methods/putt.md.
"""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, cast

from ringlight.fit.rates import Adam
from ringlight.methods.putt_rates import LAST_RATE, SETTLED_RATE, SETTLING_RATE
from ringlight.methods.putt_schedule import doublings
from ringlight.methods.putt_settings import SMALLEST_SIDE, PuttSettings
from ringlight.methods.putt_sizes import levels_of
from ringlight.methods.volume_recipe import BETAS, EPSILON, OF_ANY_SAMPLE, on_device
from ringlight.volume.tt_ranks import AXES, OCTANTS

if TYPE_CHECKING:
    from jaxtyping import Float
    from torch import Tensor

    from ringlight.fit.optimizer import Optimizer
    from ringlight.fit.regularizers.contract import Regularizer
    from ringlight.fit.strategies.contract import Strategy
    from ringlight.rasterize.contract import Rasterizer
    from ringlight.volume.model import VolumeModel
    from ringlight.volume.tensor_train_field import TensorTrainField
    from ringlight.volume.tt_scaling import Scaling

WARM_UP = 1 / 300
"""Share of a run over which the trains' rate rises: a hundred steps of the paper's."""


@dataclass(frozen=True)
class PuttRecipe(PuttSettings):
    """PuTT (Loeschcke et al. 2024): density and appearance as tensor trains, coarse to fine, and a small network."""

    @property
    def emptied(self) -> tuple[int, ...]:
        return tuple(dict.fromkeys(self.at_share(tuple(self.paper_steps * share for share in self.empty_at))))

    @property
    def refined(self) -> dict[int, float]:
        first, last = levels_of(self.coarsest), levels_of(self.finest)
        at = self.at_share(doublings(last - first, self.last_doubling, self.paper_steps))
        return {step: float(8 ** (first + 1 + k) << len(self.long_axes)) for k, step in enumerate(at)}

    def numbers_at(self, box: "Float[Tensor, '2 3']", side: int) -> int:
        sizes = replace(self.sizes, levels=levels_of(side), long=len(self.long_axes_up_to(side)))
        return sizes.numbers_in_training(self.ranks, bool(self.scaled))

    @property
    def numbers_of_sample(self) -> int:
        """With features, their gradients and those of the way there, and the eight nodes around it with their shares,
        of density and of appearance."""
        return OF_ANY_SAMPLE + 3 * self.features + 2 * 2 * OCTANTS

    def groups(self) -> dict[str, Adam]:
        """Adam's, by parameter name."""
        last, settled = (LAST_RATE, None) if self.averaged_from is not None else (SETTLING_RATE, SETTLED_RATE)
        return {
            "field.*": Adam(self.falling(self.first_rate, last, WARM_UP, settled), BETAS, EPSILON, decay=self.decay),
            "*": Adam(self.falling(self.network_rate, last, self.network_rises_over, settled), BETAS, EPSILON),
        }

    def stepped_by(self, optimizer: "Optimizer", model: "VolumeModel") -> "tuple[Strategy, ...]":
        from ringlight.fit.strategies.scaled_steps import ScaledSteps

        field = cast("TensorTrainField", model.field)

        def maps() -> "dict[str, Scaling]":
            return {f"field.{name}": scaling for name, scaling in field.scalings(self.scaled).items()}

        begins = (0, *self.refined)
        begin = begins[min(self.scaled_after, len(begins) - 1)]
        return (ScaledSteps(optimizer, maps, begin, self.orthogonal),) if self.scaled else ()

    def first_model(self, box: "Float[Tensor, '2 3']", seed: int) -> "VolumeModel":
        return self.model_of(self.coarsest, box, seed)

    def model_of(self, side: int, box: "Float[Tensor, '2 3']", seed: int = 0) -> "VolumeModel":
        """With so many nodes along each axis that is not long, drawn by ``seed``."""
        from ringlight.core.randomness import generator
        from ringlight.volume.model import VolumeModel
        from ringlight.volume.shading import FeatureShading
        from ringlight.volume.tensor_train_field import TensorTrainField

        drawn = generator(seed, 0, "volume")
        levels, deepest = (levels_of(nodes) + bool(self.long_axes) for nodes in (side, self.finest))
        field = TensorTrainField(levels, deepest, self.ranks, self.features, drawn, self.long_axes)
        return VolumeModel(field, FeatureShading(self.features, self.hidden, drawn), box)

    def terms(self, model: "VolumeModel", seed: int) -> "dict[str, Regularizer]":
        from ringlight.fit.regularizers.appearance_variation import AppearanceVariation
        from ringlight.fit.regularizers.factor_size import FactorSize

        def cores() -> list[str]:
            """Of the levels that are reached."""
            field = cast("TensorTrainField", model.field)
            return [f"field.density_train.cores.{k}" for k in range(field.levels)]

        terms: dict[str, Regularizer] = {}
        if self.l1:
            terms["l1"] = FactorSize(cores, self.l1, self.l1, until=0)
        if self.tv_appearance:
            terms["tv_appearance"] = AppearanceVariation(self.tv_appearance, seed)
        return terms

    def as_stored(self, shapes: Mapping[str, tuple[int, ...]]) -> "PuttRecipe":
        """With a model of the resolution, and of the bits of what is not empty, that a file has."""
        long = (*shapes.get("field.long_axes", ()), 0)[0]
        if long >= AXES:
            return self
        more = int(long > 0)
        ranks = [shapes.get(f"field.density_train.cores.{k}", (1,)) for k in range(levels_of(self.finest) + more)]
        levels = 1 - more + sum(bool(shape) and shape[0] > 1 for shape in ranks[1:])
        bits = shapes.get("occupied", ())
        if levels < levels_of(SMALLEST_SIDE) or len(bits) != 3:
            return self
        return _Stored(**vars(self), side=1 << levels, bits=(bits[0], bits[1], bits[2]), long=long)


@dataclass(frozen=True)
class _Stored(PuttRecipe):
    """The recipe of a file, whose training is over."""

    side: int = 4
    bits: tuple[int, int, int] = (1, 1, 1)
    long: int = 0

    @property
    def long_axes(self) -> tuple[int, ...]:
        """As many as it has; which they are its file says."""
        return tuple(range(self.long))

    def model(self, box: "Float[Tensor, '2 3']", rasterize: "Rasterizer") -> "VolumeModel":
        import torch

        model = self.model_of(self.side, box)
        model.occupied = torch.zeros(self.bits, dtype=torch.uint8)
        return on_device(model, rasterize)
