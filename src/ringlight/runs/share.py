"""A trained model as one HTML page that shows the model itself."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from statistics import fmean

import torch
from torch import Tensor

from ringlight.core.gradients import COLUMNS
from ringlight.core.stages import counted, tell
from ringlight.core.want import Want
from ringlight.core.words import MEGABYTE
from ringlight.errors import OutputError, RecipeError, RunError
from ringlight.files.atomic import refuse_existing, written_atomically
from ringlight.files.packed import Packed, pack_tensors, unpack_tensors
from ringlight.files.page.document import page_of, program_texts
from ringlight.files.page.payload import payload_of
from ringlight.files.page.shown import shown_of
from ringlight.fit.strategies.drop_least import blending_weights
from ringlight.measure import metrics
from ringlight.methods.store import StoredModel, model_of_tensors, tensors_from_cameras
from ringlight.models.splats import SplatModel
from ringlight.runs.light_pack import LightPack, relit
from ringlight.runs.opened import Opened
from ringlight.runs.page_facts import (
    background_of,
    caption_of,
    facts_of_page,
    measured_psnr,
    numbers_of_stops,
    still_of,
    stops_of,
)

SUFFIXES = (".html", ".htm")

LARGEST_PAGE = 40e6
"""Bytes of a page that is made without being asked for: one and a half million Gaussians of a mirror. Phones have no
room for more, and mail takes less."""

SMALLEST_BUDGET = 0.04e6
"""Bytes; the page's own program takes half of it, and the still picture the rest."""

MOST_PICTURES = 5
"""Training cameras from which the page's model is held against the model."""

GOOD_ENOUGH = 56.0
"""dB of these pictures from which on numbers are rounded coarsely: a tenth of the bytes for some 4 dB. Nobody sees a
difference of 50."""

WEIGHING_CAMERAS = 30
"""Training cameras that say which Gaussians show least, evenly spread."""

THINNINGS = 6
"""Times that a budget is approached: each page's size says how many Gaussians the next one may have."""

NEARLY = 0.98
"""Share of the budget that is aimed at, so that the next page is not a few bytes too large."""


@dataclass(frozen=True)
class Shared:
    """What was written. ``picture_psnr`` compares pictures of what the page holds with pictures of the model, dB, mean
    over ``pictures`` of the training cameras."""

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


@dataclass(frozen=True)
class _Page:
    packed: Packed
    gaussians: int
    document: bytes


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
    shown_of(stored.model)
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
    page, decibels = page_for(opened, model, budget, packs)
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
        pictures=len(decibels),
        picture_psnr=fmean(decibels),
    )


def page_for(
    opened: Opened, model: SplatModel, budget: float | None, packs: Sequence[LightPack]
) -> tuple[_Page, list[float]]:
    """The page with coarse numbers, or with finer ones where those show too much; and how near its pictures are, dB."""
    page = _page(opened, model, budget, packs, coarse=True)
    decibels = list(_picture_loss(opened, page.packed))
    if fmean(decibels) < GOOD_ENOUGH:
        finer = _page(opened, model, budget, packs, coarse=False)
        of_finer = list(_picture_loss(opened, finer.packed))
        if fmean(of_finer) > fmean(decibels):
            return finer, of_finer
    return page, decibels


def _page(opened: Opened, model: SplatModel, budget: float | None, packs: Sequence[LightPack], coarse: bool) -> _Page:
    """The page of all Gaussians, or of as many as fit."""
    stored, stops = opened.stored, stops_of(opened.stored.cameras)
    tell("looking at the model")
    facts = facts_of_page(stored, model, shown_of(model), stops) | {"lights": [pack.scene for pack in packs]}
    still, others = still_of(stored, model), {"cameras": numbers_of_stops(stops)}
    title = f"{stored.header.scene.name}, {stored.header.preset}"

    def page_with(tensors: dict[str, Tensor]) -> _Page:
        packed = pack_tensors(tensors, coarse=coarse)
        payload, gaussians = (
            payload_of(_lit_by(packed, packs), others, program_texts()),
            len(tensors[f"{COLUMNS}means"]),
        )
        document = b""
        for size in (0, 1):  # the caption says how large the page is with it
            caption = caption_of(stored, gaussians, len(document) * size)
            document = page_of(title, facts | {"gaussians": gaussians, "caption": caption}, payload, still)
        return _Page(packed, gaussians, document)

    tensors = model.rendering_tensors()
    page = page_with(tensors)
    if budget is None and len(page.document) > LARGEST_PAGE:
        raise RunError(
            f"{opened.file}: its page would take {len(page.document) / MEGABYTE:.0f} MB, and browsers have trouble "
            f"with more than {LARGEST_PAGE / MEGABYTE:.0f}; give --budget 20 to leave out the Gaussians that show least"
        )
    if budget is None or len(page.document) <= budget:
        return page
    order = _most_important_first(stored, model)
    spare = len(page_with(_rows(tensors, order[:1])).document)
    for _ in range(THINNINGS if spare < budget else 0):
        share = (budget * NEARLY - spare) / (len(page.document) - spare)
        page = page_with(_rows(tensors, order[: max(int(page.gaussians * share), 1)]))
        if len(page.document) <= budget:
            return page
    raise RunError(f"{opened.file}: no page of it fits into {budget / MEGABYTE:g} MB; give a larger --budget")


def _lit_by(packed: Packed, packs: Sequence[LightPack]) -> Packed:
    """With the tensors of each pack, as it stores them, below "light.0.", "light.1.", …"""
    tensors, packing = dict(packed.tensors), dict(packed.packing)
    for number, pack in enumerate(packs):
        tensors |= {f"light.{number}.{name}": tensor for name, tensor in pack.stored.tensors.items()}
        packing |= {f"light.{number}.{name}": kind for name, kind in pack.stored.packing.items()}
    return Packed(tensors, packing)


def _most_important_first(stored: StoredModel, model: SplatModel) -> Tensor:
    """Rows by what they add to the training cameras' pictures, most first."""
    count = min(len(stored.cameras), WEIGHING_CAMERAS)
    cameras = [stored.cameras[index * len(stored.cameras) // count] for index in range(count)]
    return blending_weights(model, list(counted("weighing Gaussians", cameras))).argsort(descending=True, stable=True)


def _rows(tensors: dict[str, Tensor], chosen: Tensor) -> dict[str, Tensor]:
    """The chosen rows of the table, in its order."""
    rows = chosen.sort().values
    return {name: tensor[rows] if name.startswith(COLUMNS) else tensor for name, tensor in tensors.items()}


@torch.no_grad()
def _picture_loss(opened: Opened, packed: Packed) -> Iterator[float]:
    """PSNR of what the page holds against the model, dB, from a few training cameras."""
    stored = opened.stored
    tensors = unpack_tensors(packed) | tensors_from_cameras(stored.cameras)
    after = model_of_tensors(tensors, stored.header, stored.rasterize, opened.file).model
    count = min(len(stored.cameras), MOST_PICTURES)
    cameras = [stored.cameras[index * len(stored.cameras) // count] for index in range(count)]
    background = background_of(stored)
    for camera in counted("comparing pictures", cameras):
        pictures = [one.render(camera, background, Want.EXACT).color.clamp(0, 1) for one in (after, stored.model)]
        yield metrics.psnr(*pictures)
