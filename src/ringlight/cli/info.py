"""``ringlight info MODEL``: what a model file or run folder holds."""

import shutil
import sys
import textwrap
from collections.abc import Iterator
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from ringlight.cli.arguments import ModelPath
from ringlight.cli.parse import parse
from ringlight.cli.stages import stages
from ringlight.core.words import MEGABYTE, counted, numbered

if TYPE_CHECKING:
    from ringlight.runs.facts import ModelFacts, RunFacts

MARGIN = 13
"""Width of the column of labels."""

NARROWEST, WIDEST = 60, 120
"""Characters a line."""


@dataclass(frozen=True)
class InfoArguments:
    """What a model file or run folder holds: method, settings, scene, measures, every tensor, bytes by part."""

    model: ModelPath
    """Run folder or model file."""
    json: bool = False
    """Print everything as JSON."""


def main(arguments: list[str]) -> int:
    """Tell; returns the exit code."""
    asked = parse(InfoArguments, "info", arguments)
    with stages(quiet=not sys.stderr.isatty()) as line:
        line(f"reading {asked.model}")
        from ringlight.measure.json_record import to_json
        from ringlight.runs.facts import facts_of

        facts = facts_of(asked.model)
    if asked.json:
        sys.stdout.write(to_json(facts))
    else:
        sys.stdout.write("\n".join(_lines(facts)) + "\n")
    return 0


def _lines(facts: "ModelFacts") -> Iterator[str]:
    header, scene = facts.header, facts.header.scene
    size = "{}x{}, ".format(*scene.resolution) if all(scene.resolution) else ""  # an imported model knows none
    versions = ", ".join(f"{name} {number}" for name, number in header.versions.items())
    yield _line("model", facts.file)
    kind = "" if header.preset == header.method else f" ({header.method})"
    yield _line("method", f"{header.preset}{kind}, {_steps(facts)}")
    yield _line("scene", f"{scene.name}, {size}background {scene.background}, extent {scene.extent:.3g}")
    yield _line("from", scene.source)
    for note in scene.notes:
        yield _line("", note)
    measured = [f"{name} {_number(value)}" for name, value in header.metrics.items() if value is not None]
    if measured:
        yield _line("measured", ", ".join(measured))
    if header.storage:
        yield _line("packed", _storage(header.storage))
    for edit in header.edits:
        yield _line("edited", ", ".join(f"{name} {_factors(value)}" for name, value in edit.items()))
    yield _line("written by", versions)
    if facts.run is not None:
        yield from _run_lines(facts.run)
    yield ""
    yield from _recipe_lines(header.recipe)
    yield ""
    yield from _tensor_lines(facts)


def _steps(facts: "ModelFacts") -> str:
    """How far the training came, and how far it was to go."""
    step, recipe = facts.header.step, facts.header.recipe.get("steps")
    planned = facts.run.planned if facts.run and facts.run.planned else recipe
    if step == 0 and not facts.run:
        return "not trained here"
    if isinstance(planned, int) and step > planned:  # of a run that was extended, of which this file knows nothing
        return f"step {step}, {step - planned} of them added"
    if isinstance(planned, int) and isinstance(recipe, int) and planned > recipe:
        return f"step {step} of {planned}, {planned - recipe} of them added"
    return f"step {step} of {planned}" if isinstance(planned, int) else f"step {step}"


def _run_lines(run: "RunFacts") -> Iterator[str]:
    yield _line("run", f"seed {run.seed}, device {run.device}")
    if run.psnr is not None:
        seconds = f", trained in {run.train_seconds:.0f} s" if run.train_seconds else ""
        speed = f", {run.fps:.1f} FPS" if run.fps else ""
        yield _line("report", f"{run.psnr:.2f} dB, SSIM {run.ssim_same:.4f}{seconds}{speed}")
    complete = "the run is complete" if run.scene else "but the run cannot go on, see below"
    state = f"go on with: {run.resume}" if run.resume else complete
    # Not wrapped: a command is copied whole.
    yield f"{'checkpoint':{MARGIN}}" + (f"yes; {state}" if run.has_checkpoint else "none")
    for problem in run.problems:
        yield _line("problem", problem)


def _recipe_lines(recipe: dict[str, Any]) -> Iterator[str]:
    """One line for each group of settings."""
    label = "settings"
    plain = {name: value for name, value in recipe.items() if not isinstance(value, dict)}
    groups = {"": plain} | {name: value for name, value in recipe.items() if isinstance(value, dict)}
    for group, values in groups.items():
        texts = [f"{name}={_short(value)}" for name, value in values.items()]
        yield _line(label, (f"{group}: " if group else "") + ", ".join(texts))
        label = ""


def _tensor_lines(facts: "ModelFacts") -> Iterator[str]:
    packed = any(tensor.packing for tensor in facts.tensors)
    rows = [(t.name, "x".join(map(str, t.shape)) or "scalar", t.dtype, f"{t.bytes:,}") for t in facts.tensors]
    titled = [("tensor", "shape", "type", "bytes"), *rows]
    stored = [("packed", "stored"), *((t.packing or "as it is", f"{t.bytes_stored:,}") for t in facts.tensors)]
    widths = [max(len(row[i]) for row in titled) for i in range(4)]
    for (name, shape, dtype, size), (packing, after) in zip(titled, stored, strict=True):
        line = f"{name:{widths[0]}}  {shape:>{widths[1]}}  {dtype:<{widths[2]}}  {size:>{widths[3]}}"
        yield f"{line}  {packing:<13}  {after:>{widths[3]}}" if packed else line
    yield ""
    for part, count in facts.bytes_by_part.items():
        yield f"{part:{widths[0]}}  {_size(count)}"
    made_of = numbered(facts.header.counted, facts.header.noun)
    yield f"{'rendering needs':{widths[0]}}  {_size(facts.bytes_raw)}, {made_of}"
    yield f"{'file':{widths[0]}}  {_size(facts.bytes_file)}, with {counted(facts.n_cameras, 'training camera')}"


def _size(count: int) -> str:
    """Megabytes, or bytes where those would read as nothing."""
    if count >= MEGABYTE / 1000:
        return f"{count / MEGABYTE:9.3f} MB"
    return f"{count:9} {'byte' if count == 1 else 'bytes'}"


def _line(label: str, text: str) -> str:
    """The label and the text beside it, wrapped to the terminal; paths and commands stay whole."""
    width = max(min(shutil.get_terminal_size().columns, WIDEST), NARROWEST)
    lines = textwrap.wrap(text, width - MARGIN, break_long_words=False, break_on_hyphens=False) or [""]
    return "\n".join(f"{label if i == 0 else '':{MARGIN}}{line}" for i, line in enumerate(lines))


def _storage(storage: dict[str, Any]) -> str:
    """What packing saved and cost; a field that is missing or no number is left out."""
    facts: dict[str, Any] = {name: value for name, value in storage.items() if isinstance(value, (int, float))}
    texts = []
    if {"bytes_before", "bytes_after"} <= facts.keys():
        texts.append(f"{facts['bytes_after']:,} of {facts['bytes_before']:,} bytes")
    if {"psnr_before", "psnr_after"} <= facts.keys():
        change = facts["psnr_after"] - facts["psnr_before"]
        on = counted(facts["views"], "test view") if "views" in facts else "the test views"
        views = f"on {on} ({facts['psnr_before']:.3f} dB before)"
        texts.append(f"{change:+.3f} dB {views}")
    if "picture_psnr" in facts:
        texts.append(f"pictures within {facts['picture_psnr']:.1f} dB PSNR of the model's")
    return "; ".join(texts)


def _factors(value: object) -> str:
    """Of a colour, as numbers with commas between; else as it is."""
    if not isinstance(value, list):
        return str(value)
    return ",".join(f"{factor:g}" if isinstance(factor, (int, float)) else str(factor) for factor in value)


def _number(value: object) -> str:
    return f"{value:.4g}" if isinstance(value, float) else str(value)


def _short(value: object) -> str:
    if isinstance(value, dict):
        return "(" + ", ".join(f"{name}={_short(inner)}" for name, inner in value.items()) + ")"
    return f"{value:g}" if isinstance(value, float) else str(value)
