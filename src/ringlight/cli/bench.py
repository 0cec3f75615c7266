"""``ringlight bench raster|parts|step|fps|page``: how fast this machine is, and where the time goes."""

import datetime
import sys
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import tyro

from ringlight.bench.timing import Budget
from ringlight.cli.arguments import Device
from ringlight.cli.bench_page import PageArguments
from ringlight.cli.gpu_build import tell_of_build
from ringlight.cli.parse import parse
from ringlight.cli.stages import stages
from ringlight.methods.table import method_named

if TYPE_CHECKING:
    from ringlight.bench.record import Circumstances
    from ringlight.bench.tables import Record
    from ringlight.rasterize.contract import Rasterizer


@dataclass(frozen=True)
class Common:
    """What all benchmarks share."""

    threads: int = 0
    """Threads of the kernels; 0 takes every core. RINGLIGHT_ISA=avx2 or generic forces those kernels."""
    rounds: int = 20
    """Rounds timed; medians are shown."""
    seconds: float = 5.0
    """No round of a size begins after this many seconds. Methods that take turns have so many each."""
    seed: int = 0
    """Seed of the workload."""
    json: bool = False
    """Print the record as JSON instead of tables."""
    save: str | None = None
    """Write the record to benchmarks/results/SAVE.json; an earlier one is replaced."""

    @property
    def budget(self) -> Budget:
        """Of each size, or of each of those that take turns."""
        return Budget(self.rounds, self.seconds)


@dataclass(frozen=True)
class RasterArguments:
    """Forward and backward of the rasterizer on the standard workload."""

    sizes: tuple[str, ...] = ("10k@200", "10k@400", "100k@400", "100k@800", "300k@800")
    """Gaussians@pixels on a side."""
    channels: int = 3
    """Blended channels."""
    device: Device = "auto"
    """Rasterizer. reference is plain torch and wants small sizes."""
    common: Annotated[Common, tyro.conf.arg(name="")] = field(default_factory=Common)

    def measured(self, now: "Circumstances") -> "Record":
        """The record of what was asked for."""
        from ringlight.bench.raster import RasterBench, bench_raster
        from ringlight.bench.workload import Size

        sizes = [Size.parse(text, self.channels) for text in self.sizes]
        rasterize = _rasterizer(self.device)
        rows = bench_raster(sizes, rasterize, self.common.budget, self.common.seed)
        return RasterBench(now, rasterize.name, rows)


@dataclass(frozen=True)
class PartsArguments:
    """Parts of a training step, each alone: colour models, the reflection shader, the loss, Adam."""

    names: tyro.conf.Positional[tuple[str, ...]] = (
        "harmonics",
        "basis",
        "ring",
        "ring-paper",
        "mirror",
        "reflection",
        "photometric",
        "adam",
    )
    """Colours of all Gaussians: harmonics, basis (ringlight-basis's), ring (ringlight-ring's), ring-paper, ring-exact
    (the paper's without tables), mirror. Per pixel: reflection (ringlight-mirror's shader), reflection-wide (hidden
    layers of 64), photometric (the loss). adam updates a 3dgs table."""
    sizes: tuple[str, ...] = ("10k@200", "100k@400")
    """Gaussians@pixels on a side."""
    device: Device = "auto"
    """Where the parts run."""
    common: Annotated[Common, tyro.conf.arg(name="")] = field(default_factory=Common)

    def measured(self, now: "Circumstances") -> "Record":
        """The record of what was asked for."""
        from ringlight.bench.parts import PartsBench, bench_parts
        from ringlight.bench.workload import Size

        sizes, device = [Size.parse(text) for text in self.sizes], _rasterizer(self.device).device
        return PartsBench(now, bench_parts(self.names, sizes, self.common.budget, self.common.seed, device))


@dataclass(frozen=True)
class StepArguments:
    """Training steps of methods in turns, and their stages, on the standard workload or on photographs."""

    methods: tyro.conf.Positional[tuple[str, ...]] = ("3dgs",)
    """Methods that take a step. The others are compared with the first."""
    size: str = "100k@400"
    """Gaussians@pixels of the workload."""
    scene: Path | None = None
    """Folder of photographs, or toaster or carpaint, which are bundled, in place of the workload."""
    after: int = 0
    """Training steps on the photographs before the one that is timed."""
    steps: int = 0
    """Length of the run on the photographs; schedules scale with it. 0 takes each method's own."""
    gaussians: int = 0
    """Most Gaussians on photographs; nothing is dropped. Methods that grow to it have equally many after half of the
    steps, when density control has ended. 0 leaves each method its own bound."""
    device: Device = "auto"
    """Rasterizer."""
    common: Annotated[Common, tyro.conf.arg(name="")] = field(default_factory=Common)

    def __post_init__(self) -> None:
        from ringlight.errors import RecipeError

        if not self.methods:
            raise RecipeError("bench step has no method; name one, such as 3dgs")
        if len(set(self.methods)) < len(self.methods):
            raise RecipeError(f"bench step names a method twice: {' '.join(self.methods)}; name each once")
        for name in ("after", "steps", "gaussians"):
            if getattr(self, name) < 0:
                raise RecipeError(f"--{name} is {getattr(self, name)}; give 0 or more")
            if getattr(self, name) and self.scene is None:
                raise RecipeError(f"--{name} is for photographs; name them by --scene")

    def measured(self, now: "Circumstances") -> "Record":
        """The record of what was asked for."""
        from ringlight.bench.step import bench_step, subject_of_scene, subject_of_workload
        from ringlight.bench.workload import Size

        recipes = {name: method_named(name) for name in self.methods}
        rasterize, seed = _rasterizer(self.device), self.common.seed
        if self.scene is None:
            size = Size.parse(self.size)
            subjects = [subject_of_workload(name, recipes[name], size, rasterize, seed) for name in recipes]
        else:
            run = {"after": self.after, "steps": self.steps, "gaussians": self.gaussians}
            subjects = [subject_of_scene(name, recipes[name], self.scene, rasterize, seed, **run) for name in recipes]
        return bench_step(subjects, self.common.budget, now)


@dataclass(frozen=True)
class FpsArguments:
    """Pictures per second of whole models with the light switched on."""

    methods: tuple[str, ...] = ("3dgs", "ringlight-basis")
    """Methods whose models are shown."""
    sizes: tuple[str, ...] = ("100k@400", "300k@800")
    """Gaussians@pixels on a side."""
    device: Device = "auto"
    """Rasterizer."""
    common: Annotated[Common, tyro.conf.arg(name="")] = field(default_factory=Common)

    def measured(self, now: "Circumstances") -> "Record":
        """The record of what was asked for."""
        from ringlight.bench.fps import FpsBench, bench_fps
        from ringlight.bench.workload import Size

        recipes = [(name, method_named(name)) for name in self.methods]
        rasterize, sizes = _rasterizer(self.device), [Size.parse(text) for text in self.sizes]
        rows = bench_fps(recipes, sizes, rasterize, self.common.budget, self.common.seed)
        return FpsBench(now, rasterize.name, rows)


@dataclass(frozen=True)
class BenchArguments:
    """Measure speed: medians of rounds in turns, wall and CPU time, beside what this machine can do at best."""

    what: Annotated[
        Annotated[RasterArguments, tyro.conf.subcommand("raster", prefix_name=False)]
        | Annotated[PartsArguments, tyro.conf.subcommand("parts", prefix_name=False)]
        | Annotated[StepArguments, tyro.conf.subcommand("step", prefix_name=False)]
        | Annotated[FpsArguments, tyro.conf.subcommand("fps", prefix_name=False)]
        | Annotated[PageArguments, tyro.conf.subcommand("page", prefix_name=False)],
        tyro.conf.arg(name=""),
    ]


def main(arguments: list[str]) -> int:
    """Measure and show; returns the exit code."""
    asked = parse(BenchArguments, "bench", arguments).what
    from ringlight.bench.record import circumstances, result_path, save_result
    from ringlight.bench.tables import tables
    from ringlight.cli.console import Screen
    from ringlight.cli.threads import check_threads, use_threads
    from ringlight.measure.json_record import to_json

    common = asked.common
    if common.save is not None:
        result_path(common.save)
    check_threads(common.threads)
    use_threads(common.threads)
    if not isinstance(asked, StepArguments | FpsArguments | PageArguments):
        import torch

        from ringlight import _kernels

        # As many threads for torch as for the kernels beside it; training gives it one.
        torch.set_num_threads(_kernels.threads())
    now = circumstances(datetime.datetime.now(datetime.timezone.utc).date().isoformat())
    with stages(quiet=not sys.stderr.isatty()) as line:
        line("measuring, which takes seconds to minutes")
        record = asked.measured(now)
    if common.json:
        sys.stdout.write(to_json(record))
    else:
        Screen().print(*tables(record), sep="\n")
    if common.save is not None:
        sys.stderr.write(f"written to {save_result(record, common.save)}\n")
    return 0


def _rasterizer(device: Device) -> "Rasterizer":
    from ringlight.rasterize.choose import rasterizer_for

    tell_of_build(device)
    return rasterizer_for(device)
