"""``ringlight import FILE.ply [MODEL]``: a model file of a PLY that any program of 3D Gaussians wrote."""

import sys
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import tyro

from ringlight.cli.outdated_report import tell_outdated
from ringlight.cli.parse import parse
from ringlight.cli.stages import stages
from ringlight.core.words import MEGABYTE
from ringlight.errors import ModelFileError


@dataclass(frozen=True)
class ImportArguments:
    """Make a model file of a PLY of 3D Gaussians, as viewers open it and 'ringlight export' writes it.

    The PLY holds no cameras, so name the photographs: 'ringlight eval MODEL SCENE', 'ringlight render MODEL --scene
    SCENE', 'ringlight train SCENE METHOD --from MODEL'. They must be in the world of the PLY.
    """

    file: Annotated[tyro.conf.Positional[Path], tyro.conf.arg(metavar="FILE.ply")]
    """Binary PLY with harmonics of degree 0 to 3."""
    model: Annotated[tyro.conf.Positional[Path | None], tyro.conf.arg(metavar="[MODEL.safetensors]")] = None
    """Model file to write; by default beside the PLY, under its name."""
    overwrite: bool = False
    """Replace the model file if it exists."""
    json: bool = False
    """Print the result as JSON."""


def main(arguments: list[str]) -> int:
    """Import; returns the exit code."""
    asked = parse(ImportArguments, "import", arguments)
    if not asked.file.is_file():
        raise ModelFileError(f"{asked.file}: there is no such file; name a PLY of 3D Gaussians")
    with stages(quiet=not sys.stderr.isatty()) as line:
        line(f"reading {asked.file}")
        from ringlight.measure.json_record import to_json
        from ringlight.runs.compress import SUFFIX, check_target
        from ringlight.runs.imported import model_of_ply, write_imported

        if asked.file.suffix.lower() == SUFFIX:
            raise ModelFileError(f"{asked.file}: is a model file by its name; name a PLY of 3D Gaussians")
        out = asked.model or asked.file.with_suffix(SUFFIX)
        check_target(out, asked.overwrite)
        stored = model_of_ply(asked.file)
        write_imported(stored, out)
    tell_outdated(out)
    count, _ = stored.model.rendering_size()
    if asked.json:
        record = {"file": str(out), "counted": count.number, "noun": count.noun, "bytes_file": out.stat().st_size}
        sys.stdout.write(to_json(record))
    else:
        degree = stored.header.recipe["sh_degree"]
        size = out.stat().st_size / MEGABYTE
        sys.stdout.write(f"{out}: {count}, harmonics of degree {degree}, {size:.2f} MB\n")
    return 0
