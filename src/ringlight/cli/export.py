"""``ringlight export MODEL OUT``: a file that other programs open."""

import sys
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import tyro

from ringlight.cli.arguments import ModelPath
from ringlight.cli.flags import flags_in
from ringlight.cli.parse import parse
from ringlight.cli.stages import stages
from ringlight.cli.threads import check_threads, use_threads
from ringlight.cli.unfinished import tell_unfinished
from ringlight.core.words import MEGABYTE, counted, numbered
from ringlight.errors import RecipeError
from ringlight.files.formats.table import WRITERS

if TYPE_CHECKING:
    from ringlight.runs.export import Exported


ENDINGS = f"File to write, ending in {', or '.join(f'{end} ({writer.about})' for end, writer in WRITERS.items())}."


@dataclass(frozen=True)
class ExportArguments:
    """Write a model as a file that other programs open; the suffix says which.

    Spherical harmonics are written as they are, but where opacities change with the view. Those, and a neural colour,
    are baked to harmonics of degree 3. They are fitted to what each Gaussian shows to the training cameras, then to the
    model's pictures from these cameras, which takes seconds to a minute. The error that remains is printed.
    """

    model: ModelPath
    """Run folder or model file."""
    out: Annotated[tyro.conf.Positional[Path], tyro.conf.arg(metavar=f"OUT{'|'.join(WRITERS)}", help=ENDINGS)]
    overwrite: bool = False
    """Replace the file if it exists."""
    mesh: bool = False
    """Of a volume: its surface as coloured triangles (extra [mesh])."""
    points: bool = False
    """Of a volume: points of its surface, with normals and colours (extra [mesh])."""
    fit_steps: int = 200
    """Number of the model's pictures to which harmonics are fitted; 0 for none."""
    threads: int = 0
    """Threads of the kernels; 0 takes every core."""
    json: bool = False
    """Print the result as JSON."""
    quiet: bool = False
    """No progress line."""


def main(arguments: list[str]) -> int:
    """Export; returns the exit code."""
    asked = parse(ExportArguments, "export", arguments)
    check_threads(asked.threads)
    if asked.fit_steps < 0:
        raise RecipeError(f"--fit-steps is {asked.fit_steps}; give 0 (none) or more")
    if asked.mesh and asked.points:
        raise RecipeError("--mesh and --points are given, and a file holds one of them; leave one away")
    of_surface = asked.mesh or asked.points
    if of_surface and "--fit-steps" in flags_in(arguments):
        raise RecipeError(f"--fit-steps is of harmonics; leave out {'--mesh' if asked.mesh else '--points'} or it")
    with stages(asked.quiet) as line:
        line(f"reading {asked.model}")
        from ringlight.color.basis_opacities import BasisOpacities
        from ringlight.measure.json_record import to_json
        from ringlight.runs.export import check_surface_target, check_target, export, export_surface
        from ringlight.runs.opened import open_model

        (check_surface_target if of_surface else check_target)(asked.out, asked.overwrite)
        use_threads(asked.threads)
        opened = open_model(asked.model)
        tell_unfinished(opened, asked.quiet)
        stored = opened.stored
        if of_surface:
            line("looking for the surface")
            exported = export_surface(stored, asked.out, with_triangles=asked.mesh)
        else:
            exported = export(stored, asked.out, asked.fit_steps)
    splats = stored.model.splats()
    exact_if_constant = splats is not None and isinstance(splats.color, BasisOpacities)
    sentences = f"{_size(exported)}\n" if of_surface else _sentences(exported, exact_if_constant)
    sys.stdout.write(to_json(exported) if asked.json else sentences)
    return 0


ALIKE, CLOSE = 40.0, 30.0
"""dB of pictures against each other above which a difference is hardly seen, and what changes with the view is kept
though softer. A ring's light has 55, mirrors 24 to 32 (docs/experiments/export.md)."""


def _size(exported: "Exported") -> str:
    return f"{exported.file}: {numbered(exported.counted, exported.noun)}, {exported.bytes_file / MEGABYTE:.2f} MB"


def _sentences(exported: "Exported", exact_if_constant: bool) -> str:
    size = _size(exported)
    loss = exported.loss
    if loss is None:
        return f"{size}\nother viewers show the colours as the model has them: exact\n"
    before = f" ({loss.unfitted_picture_psnr:.1f} before {counted(loss.fitted, 'step')} of fitting)" * bool(loss.fitted)
    when = " before fitting" if loss.fitted else ""
    lines = [
        size,
        "other viewers show spherical harmonics of degree 3 in place of the model's light, which is more",
        f"  pictures of the file are {loss.picture_psnr:.1f} dB PSNR from pictures of the model{before}: "
        f"{_verdict(loss.picture_psnr)}; compared from {loss.pictures} of {counted(loss.cameras, 'training camera')}",
        f"  the colour of a Gaussian, from 0 to 1, was off by {loss.rmse:.4f} (rmse){when}, of the worst by "
        f"{loss.worst:.3f}",
    ]
    if loss.opacities_vary:
        remedy = "; one of 'ringlight train SCENE ringlight-basis --no-varying-opacity' is exported exactly"
        lines.append("  the model's opacities change with the view, and the file's do not" + remedy * exact_if_constant)
    return "\n".join(lines) + "\n"


def _verdict(picture_psnr: float) -> str:
    if picture_psnr >= ALIKE:
        return f"from {ALIKE:.0f} dB on a difference is hardly seen"
    if picture_psnr >= CLOSE:
        return f"what changes with the view is softer; from {ALIKE:.0f} dB on a difference is hardly seen"
    return f"what changes with the view is lost; from about {CLOSE:.0f} dB on it is kept"
