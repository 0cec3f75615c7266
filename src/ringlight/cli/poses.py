"""``ringlight poses PHOTOS [OUT]``: find the cameras of photographs, or of a film."""

import sys
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import tyro

from ringlight.cli.deferred_end import ended_in_order
from ringlight.cli.parse import parse
from ringlight.cli.stages import stages
from ringlight.cli.threads import check_threads
from ringlight.core.command_line import command
from ringlight.errors import SceneError
from ringlight.poses.options import PosesOptions

if TYPE_CHECKING:
    from ringlight.cli.run_training import RunOptions
    from ringlight.poses.report import PosesReport


@dataclass(frozen=True)
class PosesArguments:
    """Find the cameras of photographs, or of a film, by COLMAP's structure from motion (needs the [sfm] extra).

    Writes a scene that 'ringlight train' takes: images/ (hard links, or copies on another disk), sparse/0, the picture
    cameras.png and the report poses.json. The photographs stay where they are. The same command goes on where a
    stopped one was.
    """

    photos: Annotated[tyro.conf.Positional[Path], tyro.conf.arg(metavar="PHOTOS")]
    """Folder of photographs, or a film (which needs the [video] extra)."""
    out: Annotated[tyro.conf.Positional[Path | None], tyro.conf.arg(metavar="[OUT]")] = None
    """Scene folder to make; by default PHOTOS-scene, beside the photographs."""
    options: Annotated[PosesOptions, tyro.conf.arg(name="")] = field(default_factory=PosesOptions)
    threads: int = 0
    """Threads; 0 takes every core."""
    json: bool = False
    """Print the report as JSON on standard output."""
    quiet: bool = False
    """No progress line."""


def main(arguments: list[str]) -> int:
    """Find cameras; returns the exit code."""
    asked = parse(PosesArguments, "poses", arguments)
    check_threads(asked.threads)  # not while its words are parsed: what is said then is a complaint
    if not asked.photos.exists():
        raise SceneError(f"{asked.photos}: no such folder or film; check the path")
    with stages(asked.quiet) as line:
        line(f"reading {asked.photos}")  # before libraries are loaded, which takes seconds
        from ringlight.data.load import has_cameras
        from ringlight.data.unposed import scene_beside

        known = has_cameras(asked.photos)
    if known:
        train = command("train", asked.photos, "ringlight")
        sys.stderr.write(f"warning: {asked.photos} has cameras, which are found anew here; to use its own: {train}\n")
    out = asked.out or scene_beside(asked.photos)
    report = poses_with_progress(asked.photos, out, asked.options, asked.threads, asked.quiet)
    _print(report, asked.json)
    return 0


def poses_with_progress(photos: Path, out: Path, options: PosesOptions, threads: int, quiet: bool) -> "PosesReport":
    """The report; a signal ends the work in order, and the same command goes on."""
    from ringlight.data.unposed import poses_command
    from ringlight.poses.run import find_poses

    with ended_in_order(f"go on with: {poses_command(photos, out)}"), stages(quiet) as line:
        return find_poses(photos, out, options, threads, line)


def scene_with_cameras(photos: Path, running: "RunOptions") -> Path:
    """``photos`` where it has cameras, else the scene beside it, once its cameras are found."""
    from ringlight.data.load import has_cameras
    from ringlight.data.unposed import scene_beside

    if has_cameras(photos):
        return photos
    out = scene_beside(photos)
    report = poses_with_progress(photos, out, PosesOptions(), running.threads, running.quiet)
    sys.stderr.write("".join(f"{line}\n" for line in report.lines()))
    return out


def _print(report: "PosesReport", as_json: bool) -> None:
    from ringlight.measure.json_record import to_json

    if as_json:
        sys.stdout.write(to_json(asdict(report)))
        return
    sys.stdout.write("".join(f"{line}\n" for line in report.lines()))
    sys.stderr.write(
        f"cameras and points: {report.picture}\ntrain with: {command('train', report.scene, 'ringlight')}\n"
    )
