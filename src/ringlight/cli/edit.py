"""``ringlight edit MODEL OUT.safetensors``: the same model in edited light."""

import math
import re
import sys
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import tyro

from ringlight.cli.arguments import ModelPath
from ringlight.cli.outdated_report import tell_outdated
from ringlight.cli.parse import parse
from ringlight.cli.stages import stages
from ringlight.cli.unfinished import tell_unfinished
from ringlight.core.command_line import command
from ringlight.core.words import counted, numbered
from ringlight.errors import RecipeError

if TYPE_CHECKING:
    from ringlight.methods.light_edit import LightEdit
    from ringlight.runs.edit import EditedModel

Color = Annotated[str | None, tyro.conf.arg(metavar="R,G,B|#RRGGBB")]


@dataclass(frozen=True)
class EditArguments:
    """Write a model in edited light: tinted, with more or less of what depends on the direction, or in the light of a
    pack that 'ringlight relight' made.

    The file is a model like any other: render, view, share, eval, compress, export and info take it. The background
    stays as it is. Factors are of display colours, red, green and blue from 0.1 to 4; #RRGGBB are shares of 255.
    """

    model: ModelPath
    """Run folder or model file."""
    out: Annotated[tyro.conf.Positional[Path], tyro.conf.arg(metavar="OUT.safetensors")]
    """Model file to write."""
    residual: float = 1.0
    """Times what colours have of the direction counts, 0 to 2. Opacities stay as they are."""
    base_only: bool = False
    """Leave out what colours have of the direction; the same as --residual 0."""
    tint: Color = None
    """Factors of all light: base colours and what depends on the direction."""
    tint_base: Color = None
    """Factors of the base colours alone."""
    tint_residual: Color = None
    """Factors of what depends on the direction alone."""
    light: Annotated[Path | None, tyro.conf.arg(metavar="PACK")] = None
    """Light pack of this model, or the folder that 'ringlight relight' wrote; it is taken before anything is edited."""
    overwrite: bool = False
    """Replace the file if it exists."""
    json: bool = False
    """Print the result as JSON."""
    quiet: bool = False
    """No progress line."""


def main(arguments: list[str]) -> int:
    """Edit; returns the exit code."""
    asked = parse(EditArguments, "edit", arguments)
    with stages(asked.quiet) as line:
        line(f"reading {asked.model}")
        from ringlight.measure.json_record import to_json
        from ringlight.runs.compress import check_target
        from ringlight.runs.edit import edit_light
        from ringlight.runs.light_pack import read_pack
        from ringlight.runs.opened import open_model

        edit = _edit(asked)
        check_target(asked.out, asked.overwrite)
        pack = None if asked.light is None else read_pack(asked.light)
        opened = open_model(asked.model)
        tell_unfinished(opened, asked.quiet)
        done = edit_light(opened, asked.out, edit, pack)
    tell_outdated(asked.out)
    sys.stdout.write(to_json(done) if asked.json else _sentences(done))
    return 0


def _edit(asked: EditArguments) -> "LightEdit":
    """Raises RecipeError for a factor out of its range, or where nothing is to be edited."""
    from ringlight.methods.light_edit import MOST_RESIDUAL, ONES, LightEdit

    if not 0 <= asked.residual <= MOST_RESIDUAL:
        raise RecipeError(f"--residual is {asked.residual:g}; give 0 (none) to {MOST_RESIDUAL:g} (twice as much)")
    if asked.base_only and asked.residual not in (0.0, 1.0):
        raise RecipeError(f"--base-only and --residual {asked.residual:g} do not go together; leave one of them out")
    scale = 0.0 if asked.base_only else asked.residual
    both, base, residual = (
        factors(flag, word)
        for flag, word in (
            ("--tint", asked.tint),
            ("--tint-base", asked.tint_base),
            ("--tint-residual", asked.tint_residual),
        )
    )
    edit = LightEdit(_times(both, base), _times(both, residual, (scale, scale, scale)))
    if edit == LightEdit(ONES, ONES) and asked.light is None:
        raise RecipeError("nothing is to be edited; give --residual, --base-only, --tint, or --light PACK")
    return edit


def factors(flag: str, word: str | None) -> tuple[float, float, float]:
    """Three factors of a flag's word; ones without any. Raises RecipeError for what is no colour factor."""
    from ringlight.methods.light_edit import LEAST_TINT, MOST_TINT, ONES

    if word is None:
        return ONES
    wrong = RecipeError(
        f"{flag} is {word[:40]!r}; give three factors from {LEAST_TINT:g} to {MOST_TINT:g} as 1,0.8,0.6, or a colour "
        f"as '#ffcc99', of parts from {math.ceil(255 * LEAST_TINT):02x} on"
    )
    if re.fullmatch("#[0-9a-fA-F]{6}", word):
        found = [int(word[at : at + 2], 16) / 255 for at in (1, 3, 5)]
    else:
        try:
            found = [float(part) for part in word.split(",")]
        except ValueError:
            raise wrong from None
    if len(found) != 3 or not all(LEAST_TINT <= factor <= MOST_TINT for factor in found):
        raise wrong
    return found[0], found[1], found[2]


def _times(*given: tuple[float, float, float]) -> tuple[float, float, float]:
    red, green, blue = 1.0, 1.0, 1.0
    for factor in given:
        red, green, blue = red * factor[0], green * factor[1], blue * factor[2]
    return red, green, blue


def _sentences(done: "EditedModel") -> str:
    def words(factors: tuple[float, float, float]) -> str:
        return ", ".join(f"{factor:g}" for factor in factors)

    lines = [f"{done.file}: {numbered(done.counted, done.noun)}, {done.bytes_file / 1e6:.3f} MB"]
    if done.light is not None:
        lines.append(f"  in the light of {done.light}")
    named = (("base colours", done.base), ("what depends on the direction", done.residual))
    edits = [f"{name} times {words(factors)}" for name, factors in named if factors != (1.0, 1.0, 1.0)]
    if edits:
        lines.append(f"  {'; '.join(edits)}")
    before = done.edits - 1 - (done.light is not None)
    if before:
        lines.append(
            f"  on top of {counted(before, 'edit')} that the model had; {command('info', done.file)} lists all"
        )
    if done.clipped:
        lines.append(f"  {done.clipped:.1%} of the base colours' values would be brighter than white, and are white")
    return "\n".join(lines) + "\n"
