"""``ringlight compress MODEL OUT.safetensors [SCENE]``: the same model in about a third of the bytes."""

import sys
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import tyro

from ringlight.cli.arguments import ModelPath, SceneFolder
from ringlight.cli.loading import tell_warnings
from ringlight.cli.outdated_report import tell_outdated
from ringlight.cli.parse import parse
from ringlight.cli.stages import stages
from ringlight.cli.threads import check_threads, use_threads
from ringlight.cli.unfinished import tell_unfinished
from ringlight.core.command_line import command
from ringlight.core.words import MEGABYTE, counted, numbered
from ringlight.data.options import ReadingOptions, SceneOptions
from ringlight.errors import RecipeError, RunError, SceneError

if TYPE_CHECKING:
    from ringlight.core.scene import Scene
    from ringlight.runs.compress import Compressed
    from ringlight.runs.opened import Opened


@dataclass(frozen=True)
class CompressArguments:
    """Write a model in fewer bytes: colours and opacities in 8 bit, rotations in 32, positions in 48 or 72, networks
    and tables in 8 bit a value.

    The file is a model like any other: eval, render, export, compare and info take it. The loss in PSNR is measured on
    the test views of SCENE or of the run. It is stored in the file and shown by 'ringlight info'.
    """

    model: ModelPath
    """Run folder or model file."""
    out: Annotated[tyro.conf.Positional[Path], tyro.conf.arg(metavar="OUT.safetensors")]
    """Model file to write."""
    scene: SceneFolder = None
    """Folder of photographs, or toaster or carpaint, which are bundled; by default the model's own."""
    options: Annotated[ReadingOptions, tyro.conf.arg(name="")] = field(default_factory=ReadingOptions)
    overwrite: bool = False
    """Replace the file if it exists."""
    threads: int = 0
    """Threads of the kernels; 0 takes every core."""
    json: bool = False
    """Print the result as JSON."""
    quiet: bool = False
    """No progress line."""


def main(arguments: list[str]) -> int:
    """Compress; returns the exit code."""
    asked = parse(CompressArguments, "compress", arguments)
    check_threads(asked.threads)
    with stages(asked.quiet) as line:
        line(f"reading {asked.model}")
        from ringlight.measure.json_record import to_json
        from ringlight.runs.compress import check_target, compress
        from ringlight.runs.opened import open_model

        check_target(asked.out, asked.overwrite)
        use_threads(asked.threads)
        opened = open_model(asked.model)
        tell_unfinished(opened, asked.quiet)
        scene = _scene(asked, opened)
        compressed = compress(opened, asked.out, scene, partial(line, "measuring views"))
    tell_outdated(asked.out)
    sys.stdout.write(to_json(compressed) if asked.json else _sentences(compressed))
    return 0


def _scene(asked: CompressArguments, opened: "Opened") -> "Scene | None":
    """The photographs to measure on; None where the model's own have gone, or it does not know them."""
    from ringlight.runs.opened import scene_of

    options = SceneOptions(**vars(asked.options))
    asks = asked.scene is not None or options != SceneOptions()
    try:
        scene = scene_of(opened, asked.scene, options, command("compress", asked.model, asked.out, "FOLDER"))
        tell_warnings(scene)
        return scene
    except (RunError, RecipeError, SceneError) as error:
        if asks and not isinstance(error, RunError):
            raise
        if not asked.quiet:
            sys.stderr.write(f"not measured on photographs: {error}\n")
        return None


def _sentences(compressed: "Compressed") -> str:
    losses = compressed.losses
    ratio = losses.bytes_before / max(losses.bytes_after, 1)
    lines = [
        f"{compressed.file}: {numbered(compressed.counted, compressed.noun)}, "
        f"{compressed.bytes_file / MEGABYTE:.3f} MB instead of {compressed.bytes_file_before / MEGABYTE:.3f} MB",
        f"  what rendering needs: {losses.bytes_after:,} of {losses.bytes_before:,} bytes, {ratio:.2f} times smaller",
    ]
    if losses.picture_psnr is not None:
        lines.append(
            f"  its pictures against the model's, from {counted(losses.pictures, 'training camera')}: "
            f"{losses.picture_psnr:.1f} dB PSNR"
        )
    if losses.psnr_before is not None and losses.psnr_after is not None:
        change = losses.psnr_after - losses.psnr_before
        lines.append(f"  on {counted(losses.views or 0, 'test view')}: {change:+.3f} dB, from {losses.psnr_before:.2f}")
    else:
        lines.append("  not measured on photographs: name a scene's folder that has test views for that")
    return "\n".join(lines) + "\n"
