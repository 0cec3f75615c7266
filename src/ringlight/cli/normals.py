"""``ringlight normals RUN ... --truth FILE.npz``: how right models' normals are."""

import sys
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import tyro

from ringlight.cli.arguments import Device, MaybeFolder
from ringlight.cli.gpu_build import tell_of_build
from ringlight.cli.loading import tell_warnings
from ringlight.cli.parse import parse, refuse
from ringlight.cli.stages import StageLine, stages
from ringlight.cli.threads import check_threads, use_threads
from ringlight.core.command_line import command
from ringlight.data.options import SceneOptions

if TYPE_CHECKING:
    from ringlight.core.scene import Scene
    from ringlight.data.true_normals import TrueNormals
    from ringlight.runs.normals import MeasuredNormals
    from ringlight.runs.opened import Opened


@dataclass(frozen=True)
class NormalsArguments:
    """How right the normals of models are: the angle to true ones, in degrees, over the test views that a file names.

    A pixel counts where the file has a normal and the model's alpha is at least a half. docs/normals.md defines the
    file and says how to make one.
    """

    runs: Annotated[
        tyro.conf.Positional[tuple[Path, ...]], tyro.conf.arg(metavar="RUN [RUN ...]", help_behavior_hint="(required)")
    ]
    """Run folders or model files."""
    truth: Annotated[Path, tyro.conf.arg(metavar="FILE.npz")]
    """True world normals of test views."""
    scene: MaybeFolder = None
    """Folder of photographs with the test views; by default each model's own."""
    pictures: MaybeFolder = None
    """New folder for a picture of each view: the model's normals, the true ones, the angle between them."""
    device: Device = "auto"
    """Rasterizer: auto is the fastest that this machine has."""
    threads: int = 0
    """Threads of the kernels; 0 takes every core."""
    json: bool = False
    """Print the measures as JSON, also of each view."""
    quiet: bool = False
    """No progress line."""


def main(arguments: list[str]) -> int:
    """Compare; returns the exit code."""
    asked = parse(NormalsArguments, "normals", arguments)
    if not asked.runs:
        refuse("normals", "no runs are named; give the folders that 'ringlight train' wrote")
    check_threads(asked.threads)
    with stages(asked.quiet) as line:
        line(f"reading {asked.truth}")
        from ringlight.data.true_normals import read_true_normals
        from ringlight.runs.folder import empty_folder
        from ringlight.runs.opened import find_model

        truth = read_true_normals(asked.truth)
        for run in asked.runs:
            find_model(run)
        if asked.pictures is not None:
            empty_folder(asked.pictures, "--pictures")
        use_threads(asked.threads)
        tell_of_build(asked.device)
        labels = _labels(asked.runs)
        measured = [_measured(asked, index, label, truth, line) for index, label in enumerate(labels)]
    _print(asked, labels, measured)
    return 0


def _labels(runs: Sequence[Path]) -> list[str]:
    """The name of each folder or file, or where two are alike the paths."""
    names = [run.resolve().name for run in runs]
    return names if len(set(names)) == len(names) else [str(run) for run in runs]


def _measured(
    asked: NormalsArguments, index: int, label: str, truth: "TrueNormals", line: StageLine
) -> "MeasuredNormals":
    from ringlight.measure.picture_names import folder_name
    from ringlight.runs.normals import measure_normals
    from ringlight.runs.opened import open_model

    run, runs = asked.runs[index], len(asked.runs)
    line(f"reading {run}")
    opened = open_model(run, asked.device)
    scene = _scene(asked, run, opened)
    pictures = asked.pictures / folder_name(label) if asked.pictures and runs > 1 else asked.pictures

    def tell(done: int, views: int) -> None:
        line("comparing normals", index * views + done, runs * views)

    return measure_normals(opened, scene, truth, pictures, tell)


def _scene(asked: NormalsArguments, run: Path, opened: "Opened") -> "Scene":
    from ringlight.runs.opened import scene_of

    again = command("normals", run, "--truth", asked.truth, "--scene", "FOLDER")
    scene = scene_of(opened, asked.scene, SceneOptions(), again)
    tell_warnings(scene)
    return scene


def _print(asked: NormalsArguments, labels: Sequence[str], measured: Sequence["MeasuredNormals"]) -> None:
    from ringlight.cli.console import Screen
    from ringlight.measure.json_record import to_json
    from ringlight.measure.normals_table import NormalsTable

    if asked.json:
        runs = [_record(run, label, one) for run, label, one in zip(asked.runs, labels, measured, strict=True)]
        sys.stdout.write(to_json({"truth": str(asked.truth), "runs": runs}))
    else:
        rows = [(label, one.score) for label, one in zip(labels, measured, strict=True)]
        Screen().print(NormalsTable(rows, len(measured[0].views)))
    sys.stdout.flush()
    if asked.pictures is not None and not asked.quiet:
        sys.stderr.write(f"pictures: {asked.pictures}\n")


def _record(run: Path, label: str, measured: "MeasuredNormals") -> dict[str, Any]:
    views = [{"name": name, **vars(score)} for name, score in measured.views]
    return {"label": label, "run": str(run), **vars(measured.score), "views": len(views), "per_view": views}
