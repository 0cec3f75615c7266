"""A trained model as one HTML page that shows the model itself."""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from ringlight.core.words import MEGABYTE
from ringlight.errors import OutputError, RecipeError, RunError
from ringlight.files.atomic import refuse_existing, written_atomically
from ringlight.files.page.shown import shown_of
from ringlight.runs.light_pack import LightPack, relit
from ringlight.runs.opened import Opened
from ringlight.runs.page_facts import measured_psnr, stops_of
from ringlight.runs.sized_page import page_for

SUFFIXES = (".html", ".htm")

SMALLEST_BUDGET = 0.04e6
"""Bytes; the page's own program takes half of it, and the still picture the rest."""


@dataclass(frozen=True)
class Shared:
    """What was written. ``picture_psnr`` compares pictures of what the page holds with pictures of the model, dB, mean
    over those that differ of ``pictures`` training cameras; infinite where none does."""

    file: str
    bytes_file: int
    counted: int
    counted_before: int
    noun: str
    method: str
    psnr: float | None
    """Of the model on its test views, as its file says; dB."""
    stops: int
    """Training cameras that the page keeps."""
    pictures: int
    picture_psnr: float


def check_target(path: Path, overwrite: bool) -> None:
    """Raises OutputError for another suffix than a page's, or a file that exists and may not be replaced."""
    if path.suffix.lower() not in SUFFIXES:
        raise OutputError(f"{path}: cannot be written: the page is an HTML file; end its name in {SUFFIXES[0]}")
    refuse_existing(path, overwrite)


def share(opened: Opened, path: Path, budget: float | None = None, packs: Sequence[LightPack] = ()) -> Shared:
    """Write the page. With a ``budget`` in bytes the Gaussians that show least are left out until it fits.

    The page blends between the model's own light and that of each of the ``packs``.

    Raises RunError for a model without cameras or Gaussians, or one whose page would be too large, RecipeError for a
    model that a page cannot show, ModelFileError for a pack of another model, OutputError where the file cannot be
    written.
    """
    stored = opened.stored
    if budget is not None and not budget >= SMALLEST_BUDGET:
        least = SMALLEST_BUDGET / MEGABYTE
        raise RecipeError(f"--budget is {budget / MEGABYTE:g} MB; give at least {least:g}, or no page fits")
    shown = shown_of(stored.model, stored.header.preset)
    if packs and not shown.blends:
        raise RecipeError(f"a page of {stored.header.preset} shows one light; leave out --light")
    model = stored.model.splats()
    if model is None or not len(model):
        raise RunError(f"{opened.file}: holds no Gaussians, so there is nothing to show")
    if not stored.cameras:
        raise RunError(
            f"{opened.file}: holds no cameras, so there is nowhere to look from; name a model that 'ringlight train' "
            "wrote, or give it photographs: ringlight train SCENE METHOD --from FILE"
        )
    for pack in packs:
        relit(stored, pack, opened.file)
    page = page_for(opened, model, budget, packs)
    with written_atomically(path) as file:
        file.write(page.document)
    return Shared(
        file=str(path),
        bytes_file=len(page.document),
        counted=page.gaussians,
        counted_before=len(model),
        noun=stored.header.noun,
        method=stored.header.preset,
        psnr=measured_psnr(stored),
        stops=len(stops_of(stored.cameras)),
        pictures=len(page.decibels),
        picture_psnr=page.nearness,
    )
