"""``ringlight train SCENE METHOD``: learn a scene from a folder of posed photographs."""

import sys
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import tyro

from ringlight.cli.arguments import Device, MaybeFolder
from ringlight.cli.fitting import ReaderOptions, fit
from ringlight.cli.main import INTERRUPTED
from ringlight.cli.methods import Method, preset_of
from ringlight.cli.parse import parse, refuse
from ringlight.data.options import SceneOptions
from ringlight.errors import RecipeError
from ringlight.methods.table import METHODS, method_named

if TYPE_CHECKING:
    from ringlight.runs.session import Session


@dataclass(frozen=True)
class TrainArguments:
    """Learn a scene from posed photographs.

    Writes a run folder: model.safetensors, report.json, recipe.json, a checkpoint and images/. Ctrl-C finishes the
    step and saves; ``ringlight train --resume RUN`` goes on from there.
    """

    scene: Annotated[tyro.conf.Positional[Path], tyro.conf.arg(metavar="SCENE")]
    """Folder of photographs with cameras: COLMAP, Blender/NeRF-Synthetic or nerfstudio layout."""
    method: Method
    options: Annotated[SceneOptions, tyro.conf.arg(name="")] = field(default_factory=SceneOptions)
    reader: Annotated[ReaderOptions, tyro.conf.arg(name="")] = field(default_factory=ReaderOptions)
    out: MaybeFolder = None
    """Run folder to make; by default runs/SCENE-METHOD."""
    seed: int = 0
    """Same seed, same machine kind: the same bits."""
    device: Device = "auto"
    """Rasterizer: auto is the fastest that this machine has; reference is slow, plain torch."""


@dataclass(frozen=True)
class ResumeArguments:
    """Go on with a run that was stopped, with the same bits as if it had never stopped."""

    resume: Annotated[Path, tyro.conf.arg(metavar="RUN")]
    """Run folder with a checkpoint."""
    reader: Annotated[ReaderOptions, tyro.conf.arg(name="")] = field(default_factory=ReaderOptions)


def main(arguments: list[str]) -> int:
    """Train, then measure; returns the exit code."""
    if any(word == "--resume" or word.startswith("--resume=") for word in arguments):
        wish = parse(ResumeArguments, "train", arguments)
        from ringlight.cli.threads import use_threads
        from ringlight.runs.session import Session

        use_threads(wish.reader.threads)
        return _train(Session.resume(wish.resume), wish.reader)
    # The parser would tell which words it knows, but not which of them is near.
    if len(arguments) > 1 and not any(w.startswith("-") for w in arguments[:2]) and not METHODS.keys() & set(arguments):
        try:
            method_named(arguments[1])
        except RecipeError as error:
            refuse("train", str(error))
    asked = parse(TrainArguments, "train", arguments)
    preset = preset_of(arguments, asked.method)
    from ringlight.cli.threads import use_threads
    from ringlight.runs.folder import free_folder
    from ringlight.runs.session import Session

    use_threads(asked.reader.threads)
    out = asked.out or free_folder(Path("runs") / f"{asked.scene.resolve().name}-{preset}")
    session = Session.start(out, asked.scene, preset, asked.method, asked.options, asked.seed, asked.device)
    return _train(session, asked.reader)


def _train(session: "Session", options: ReaderOptions) -> int:
    from rich.console import Console

    from ringlight.measure.table import ResultsTable

    report = fit(session, options, f"ringlight train --resume {session.folder.path}")
    if report is None:
        return INTERRUPTED
    if options.json:
        sys.stdout.write(report.to_json())
    else:
        Console().print(ResultsTable([(report.preset, report)]))
        sys.stderr.write(f"written to {session.folder.path}; see it with: ringlight render {session.folder.path}\n")
    return 0
