"""``ringlight export MODEL OUT.ply``: a file that other viewers open."""

import sys
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import tyro

from ringlight.cli.arguments import ModelPath
from ringlight.cli.parse import parse
from ringlight.errors import RecipeError

if TYPE_CHECKING:
    from ringlight.runs.export import Exported


@dataclass(frozen=True)
class ExportArguments:
    """Write a model as the PLY file that viewers of 3D Gaussians open.

    Spherical harmonics are written as they are. A neural colour is baked to harmonics of degree 3. They are fitted to
    what each Gaussian shows to the training cameras, then to the model's pictures from these cameras, which takes
    seconds to a minute. The error that remains is printed.
    """

    model: ModelPath
    """Run folder or model file."""
    out: Annotated[tyro.conf.Positional[Path], tyro.conf.arg(metavar="OUT.ply")]
    """File to write, ending in .ply."""
    overwrite: bool = False
    """Replace the file if it exists."""
    fit_steps: int = 200
    """Number of the model's pictures to which harmonics are fitted; 0 for none."""
    threads: int = 0
    """Threads of the kernels; 0 takes every core."""
    json: bool = False
    """Print the result as JSON."""


def main(arguments: list[str]) -> int:
    """Export; returns the exit code."""
    asked = parse(ExportArguments, "export", arguments)
    from ringlight.cli.threads import use_threads
    from ringlight.measure.json_record import to_json
    from ringlight.runs.export import check_target, export_ply
    from ringlight.runs.opened import open_model

    if asked.fit_steps < 0:
        raise RecipeError(f"--fit-steps is {asked.fit_steps}; give 0 (none) or more")
    check_target(asked.out, asked.overwrite)
    use_threads(asked.threads)
    exported = export_ply(open_model(asked.model).stored, asked.out, asked.fit_steps)
    sys.stdout.write(to_json(exported) if asked.json else _sentences(exported))
    return 0


def _sentences(exported: "Exported") -> str:
    lines = [f"{exported.file}: {exported.n_gaussians:,} Gaussians, {exported.bytes_file / 1e6:.2f} MB"]
    if exported.baked:
        fitted = f" ({exported.unfitted_picture_psnr:.1f} before {exported.fitted} steps of fitting)"
        lines += [
            f"colour baked to spherical harmonics of degree 3 from {exported.cameras} training cameras",
            f"  pictures of the PLY against the model's, from {exported.pictures} of them: "
            f"{exported.picture_psnr:.1f} dB PSNR{fitted if exported.fitted else ''}",
            f"  colour of single Gaussians{', before' if exported.fitted else ''}, 0 to 1, over the directions of "
            f"those cameras: rmse {exported.rmse:.4f} ({exported.psnr:.1f} dB), {exported.worst:.3f} for the worst",
        ]
    else:
        lines += ["colour is spherical harmonics already: exact"]
    return "\n".join(lines) + "\n"
