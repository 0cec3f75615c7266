"""The page of a model, as coarse as its pictures allow, and thinned to a budget where there is one."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass

import torch
from torch import Tensor

from ringlight.color.illuminated import Illuminated
from ringlight.color.shaded_gaussians import ShadedGaussians
from ringlight.core.camera import Camera
from ringlight.core.gradients import COLUMNS
from ringlight.core.stages import counted, tell
from ringlight.core.visible_text import visible
from ringlight.core.want import Want
from ringlight.core.words import MEGABYTE
from ringlight.errors import RunError
from ringlight.files.pack_axes import pack_with_axes
from ringlight.files.packed import Packed, pack_tensors, unpack_tensors
from ringlight.files.page.blurred_light import with_maps
from ringlight.files.page.document import page_of, program_texts
from ringlight.files.page.payload import payload_of
from ringlight.files.page.shown import shown_of
from ringlight.fit.strategies.blending_weights import blending_weights
from ringlight.fit.strategies.removal_effects import removal_effects
from ringlight.measure import metrics
from ringlight.methods.store import StoredModel, model_of_tensors, tensors_from_cameras
from ringlight.models.splats import SplatModel
from ringlight.runs.condensed_page import CondensedPage, condensed_header
from ringlight.runs.light_pack import LightPack
from ringlight.runs.opened import Opened
from ringlight.runs.page_facts import background_of, caption_of, facts_of_page, numbers_of_stops, still_of, stops_of

LARGEST_PAGE = 40e6
"""Bytes of a page that is made without being asked for: one and a half million Gaussians of a mirror. Phones have no
room for more, and mail takes less."""

MOST_PICTURES = 5
"""Training cameras from which the page's model is held against the model."""

GOOD_ENOUGH = 56.0
"""dB of these pictures from which on numbers are rounded coarsely: a seventh of the bytes for some 5 dB. Nobody sees a
difference of 50."""

WEIGHING_CAMERAS = 30
"""Training cameras that say which Gaussians show least, evenly spread."""

THINNINGS = 6
"""Times that a budget is approached: each page's size says how many Gaussians the next one may have."""

NEARLY = 0.98
"""Share of the budget that is aimed at, so that the next page is not a few bytes too large."""


@dataclass(frozen=True)
class Page:
    """A document, what it holds, and how near pictures of that are to the model's: dB, from each camera compared."""

    packed: Packed
    gaussians: int
    document: bytes
    decibels: tuple[float, ...] = ()

    @property
    def nearness(self) -> float:
        """Their mean over the pictures that differ, dB: one that shows nothing would hide what the others lose."""
        return metrics.psnr_of_different(self.decibels)


def page_for(opened: Opened, model: SplatModel, budget: float | None, packs: Sequence[LightPack]) -> Page:
    """The page with coarse numbers, with finer ones where those show too much, or with as many Gaussians as fit.

    Raises RunError for a page that is too large without a ``budget`` in bytes, or for a budget that none fits.
    """
    pages = _Pages(opened, model, packs)
    tensors = pages.tensors()
    whole = pages.of(tensors, coarse=True)
    if budget is None and len(whole.document) > LARGEST_PAGE:
        raise RunError(
            f"{opened.file}: its page would take {len(whole.document) / MEGABYTE:.0f} MB, and browsers have trouble "
            f"with more than {LARGEST_PAGE / MEGABYTE:.0f}; give --budget 20 to leave out the Gaussians that show least"
        )
    if budget is not None and len(whole.document) > budget:
        return _thinned(pages, tensors, whole, budget)
    compared = pages.compared(whole)
    if compared.nearness >= GOOD_ENOUGH or pages.axes_are_normals:  # of these there is no finer page
        return compared
    finer = pages.of(tensors, coarse=False)
    if len(finer.document) > (LARGEST_PAGE if budget is None else budget):
        return compared
    return _nearer(compared, pages.compared(finer))


class _Pages:
    """Pages of one model, with all that does not depend on which of its Gaussians they hold."""

    def __init__(self, opened: Opened, model: SplatModel, packs: Sequence[LightPack]):
        self.opened, self.model, self.packs = opened, model, packs
        stored, stops = opened.stored, stops_of(opened.stored.cameras)
        tell("looking at the model")
        shown = shown_of(model)
        self.axes_are_normals = model.color.axes_are_normals
        self.condensed = CondensedPage(model.color, model) if isinstance(model.color, Illuminated) else None
        facts = facts_of_page(stored, model, shown, stops)
        self.facts = facts | {"lights": [visible(pack.scene) for pack in packs]}
        self.still, self.others = still_of(stored, model), {"cameras": numbers_of_stops(stops)}
        self.title = visible(f"{stored.header.scene.name}, {stored.header.preset}")

    def tensors(self) -> dict[str, Tensor]:
        """What pages hold of the model, before it is thinned and packed."""
        tensors = self.model.rendering_tensors()
        return self.condensed.tensors(tensors) if self.condensed else tensors

    def of(self, tensors: Mapping[str, Tensor], coarse: bool) -> Page:
        """Never ``coarse`` where a reflection goes by the axes."""
        if self.condensed:
            packed = self.condensed.packed(tensors, coarse)
        elif self.axes_are_normals:
            packed = pack_with_axes(tensors)
        else:
            packed = pack_tensors(tensors, coarse=coarse)
        payload = payload_of(self._drawn_from(packed), self.others, program_texts())
        gaussians, document = len(tensors[f"{COLUMNS}means"]), b""
        for size in (0, 1):  # the caption says how large the page is with it
            caption = caption_of(self.opened.stored, gaussians, len(document) * size)
            facts = self.facts | {"gaussians": gaussians, "caption": caption}
            document = page_of(self.title, facts, payload, self.still)
        return Page(packed, gaussians, document)

    def _drawn_from(self, packed: Packed) -> Packed:
        """What the page's program reads of the model and of all packs."""
        lit, color = _lit_by(packed, self.packs), self.model.color
        return with_maps(lit, color.light) if isinstance(color, ShadedGaussians) else lit

    def compared(self, page: Page) -> Page:
        return Page(page.packed, page.gaussians, page.document, tuple(_nearness(self.opened, page.packed)))


def _thinned(pages: _Pages, tensors: Mapping[str, Tensor], whole: Page, budget: float) -> Page:
    """What shows least can be told in two ways, and which is better depends on the model: both are tried."""
    spare = len(pages.of(_rows(tensors, torch.zeros(1, dtype=torch.long)), coarse=True).document)
    best: Page | None = None
    for worth in (_by_weights, _by_effects):
        order = worth(pages.opened.stored, pages.model).argsort(descending=True, stable=True)
        page = whole
        for _ in range(THINNINGS if spare < budget else 0):
            share = (budget * NEARLY - spare) / (len(page.document) - spare)
            page = pages.of(_rows(tensors, order[: max(int(page.gaussians * share), 1)]), coarse=True)
            if len(page.document) <= budget:
                best = _nearer(best, pages.compared(page))
                break
    if best is None:
        raise RunError(f"{pages.opened.file}: no page of it fits into {budget / MEGABYTE:g} MB; give a larger --budget")
    return best


def _nearer(one: Page | None, other: Page) -> Page:
    return one if one is not None and one.nearness >= other.nearness else other


def _lit_by(packed: Packed, packs: Sequence[LightPack]) -> Packed:
    """With the tensors of each pack, as it stores them, below "light.0.", "light.1.", …"""
    tensors, packing = dict(packed.tensors), dict(packed.packing)
    for number, pack in enumerate(packs):
        tensors |= {f"light.{number}.{name}": tensor for name, tensor in pack.stored.tensors.items()}
        packing |= {f"light.{number}.{name}": kind for name, kind in pack.stored.packing.items()}
    return Packed(tensors, packing)


def _by_weights(stored: StoredModel, model: SplatModel) -> Tensor:
    """What each row adds to the training cameras' pictures."""
    cameras = _spread(stored.cameras, WEIGHING_CAMERAS)
    return blending_weights(model, list(counted("weighing Gaussians", cameras)))


def _by_effects(stored: StoredModel, model: SplatModel) -> Tensor:
    """What these pictures would lose without each row alone."""
    cameras = _spread(stored.cameras, WEIGHING_CAMERAS)
    watched = list(counted("trying pictures without each Gaussian", cameras))
    return removal_effects(model, watched, background_of(stored), seed=0, step=0)


def _rows(tensors: Mapping[str, Tensor], chosen: Tensor) -> dict[str, Tensor]:
    """The chosen rows of the table, in its order."""
    rows = chosen.sort().values
    return {name: tensor[rows] if name.startswith(COLUMNS) else tensor for name, tensor in tensors.items()}


def model_held(opened: Opened, packed: Packed) -> StoredModel:
    """The model that a page of these tensors shows."""
    stored, tensors = opened.stored, unpack_tensors(packed)
    model, header = stored.model.splats(), stored.header
    if model is not None and isinstance(model.color, Illuminated):
        header = condensed_header(header, model.color, tensors)
    return model_of_tensors(tensors | tensors_from_cameras(stored.cameras), header, stored.rasterize, opened.file)


@torch.no_grad()
def _nearness(opened: Opened, packed: Packed) -> Iterator[float]:
    """PSNR of what the page holds against the model, dB, from a few training cameras; infinite where both are alike."""
    stored, after = opened.stored, model_held(opened, packed).model
    background = background_of(stored)
    for camera in counted("comparing pictures", _spread(stored.cameras, MOST_PICTURES)):
        pictures = [one.render(camera, background, Want.EXACT).color.clamp(0, 1) for one in (after, stored.model)]
        yield metrics.psnr(*pictures)


def _spread(cameras: Sequence[Camera], most: int) -> list[Camera]:
    count = min(len(cameras), most)
    return [cameras[index * len(cameras) // count] for index in range(count)]
