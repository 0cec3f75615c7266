"""Speed of the colour models: what each Gaussian of the standard workload emits towards its camera."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import torch
from torch import nn

from ringlight.bench.record import Circumstances
from ringlight.bench.timing import TOTAL, Budget, Contestant, Timing, interleaved
from ringlight.bench.workload import Size, Workload, workload
from ringlight.color.contract import ColorModel
from ringlight.color.harmonics import SphericalHarmonics
from ringlight.color.ringlight import RingLight
from ringlight.core.gaussians import Gaussians
from ringlight.core.gradients import Gradients
from ringlight.core.randomness import generator
from ringlight.core.rendering import Emission
from ringlight.core.scene import PointCloud
from ringlight.core.want import Want
from ringlight.errors import RecipeError
from ringlight.methods.ringlight_ring import OURS, PAPER
from ringlight.models.splats import move

PIXELS = 400
"""The camera's image; it decides nothing but which Gaussians are in view, and all are."""

SHOW, FORWARD, BACKWARD = "show", "forward", "backward"


@dataclass(frozen=True)
class ColorRow:
    """One colour model on N Gaussians. ``show`` wants no gradient, as in rendering; ``both`` is a training step's."""

    model: str
    gaussians: int
    show: Timing
    forward: Timing
    backward: Timing
    both: Timing


@dataclass(frozen=True)
class ColorBench:
    """What ``ringlight bench color`` measured."""

    circumstances: Circumstances
    rows: tuple[ColorRow, ...]


def color_models() -> dict[str, ColorModel]:
    """The colour models by name, as the presets of their methods set them; the light fields are switched on."""
    box = torch.tensor([[-1.0, -1.0, -1.0], [1.0, 1.0, 1.0]])
    return {
        "harmonics": SphericalHarmonics(),
        "ring": RingLight(OURS, box),
        "ring-paper": RingLight(PAPER.light, box),
        "ring-exact": RingLight(replace(PAPER.light, evaluation="exact"), box),
    }


def bench_color(
    names: Sequence[str], counts: Sequence[int], budget: Budget, seed: int = 0, device: torch.device | None = None
) -> tuple[ColorRow, ...]:
    """Time the named models on each number of Gaussians; the models take turns. ``device`` is the CPU unless given.

    Raises RecipeError for an unknown model.
    """
    known = color_models()
    unknown = [name for name in names if name not in known]
    if unknown:
        raise RecipeError(f"no colour model is called {unknown[0]!r}; known: {', '.join(known)}")
    chosen, there = {name: known[name] for name in names}, device or torch.device("cpu")
    for model in chosen.values():
        if isinstance(model, nn.Module) and there.type != "cpu":
            move(model, there)
    return tuple(row for count in counts for row in _rows(chosen, count, budget, seed, there))


class _Colors:
    """One colour model on one table, with gradients of the columns and of the shared parameters."""

    def __init__(self, model: ColorModel, work: Workload, seed: int, device: torch.device):
        appearance = model.new_columns(PointCloud(work.gaussians.means, work.channels))
        columns = work.gaussians.columns() | appearance
        self.gaussians = Gaussians.from_columns({name: c.to(device, copy=True) for name, c in columns.items()})
        self.model, self.camera = model, work.camera
        self.upstream = torch.randn(work.channels.shape, generator=generator(seed, 0, "colour gradient")).to(device)
        self.of_opacity = torch.zeros_like(self.gaussians.opacity_logits)

    def show(self) -> None:
        self._emitted(Want.EXACT)

    def forward(self) -> None:
        self.emission = self._emitted(Want.GRADIENTS)

    def backward(self) -> None:
        of_opacity = None if self.emission.opacity_factor is None else self.of_opacity
        self.emission.backward(self.upstream, of_opacity, Gradients())

    def _emitted(self, want: Want) -> Emission:
        emission = self.model.emit(self.gaussians, self.camera, ("rgb",), want)
        assert len(emission.channels)  # so that lazy colours are worked out
        return emission


def _rows(models: dict[str, ColorModel], count: int, budget: Budget, seed: int, device: torch.device) -> list[ColorRow]:
    work = workload(Size(count, PIXELS), seed)
    contestants = {}
    for name, model in models.items():
        colors = _Colors(model, work, seed, device)
        contestants[f"{name} {SHOW}"] = Contestant({SHOW: colors.show})
        contestants[name] = Contestant({FORWARD: colors.forward, BACKWARD: colors.backward})
    timings = interleaved(contestants, budget)
    return [
        ColorRow(
            model=name,
            gaussians=count,
            show=timings[f"{name} {SHOW}"][SHOW],
            forward=timings[name][FORWARD],
            backward=timings[name][BACKWARD],
            both=timings[name][TOTAL],
        )
        for name in models
    ]
