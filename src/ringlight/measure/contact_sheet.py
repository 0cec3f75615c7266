"""Methods side by side in one picture: full views, the box where they differ most, and where each is wrong.

One block per view: the photograph and every method's render with its PSNR, below each the marked box enlarged (pixels
kept square) and the map of its error. All error maps of a sheet share one scale, drawn below each photograph.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float
from PIL import Image, ImageDraw, ImageFont

from ringlight.errors import RunError
from ringlight.measure import metrics
from ringlight.measure.colormap import ember
from ringlight.measure.disagreement import Box, Pictures, choose_box, choose_views, difference_map, pixels
from ringlight.measure.sheet_layout import GAP, INNER_GAP, MARGIN, PAPER, Panel, box_size, panel
from ringlight.measure.sheet_text import cut, wrapped

INK, FAINT, FRAME = "#1c1f26", "#7a808c", "#d5d8de"
BEST = "#0b7a4b"
MARK = "#e5215a"
"""Of the box; occurs in neither white paper nor most photographs."""

TITLE_SIZE, LABEL_SIZE, TEXT_SIZE, SMALL_SIZE = 26, 20, 16, 13
LINE = 1.6
"""Height of a line of text over the size of its letters."""
BLOCK_GAP = 30

ABOUT = "Marked: where the pictures differ most. Error: mean over RGB of |render - truth|"
"""The foot of a sheet, but for the scale's end."""

SCALE_TOPS = (0.02, 0.04, 0.06, 0.08, 0.1, 0.12, 0.16, 0.2, 0.3, 0.4, 0.6, 0.8, 1.0)
"""Errors at which a scale may end: numbers that one can read."""
SCALE_QUANTILE = 0.99
"""The scale ends above this part of all errors, so that single bright pixels do not darken the rest."""


@dataclass(frozen=True)
class SheetColumn:
    """One method's renders by the name of their view."""

    label: str
    images: Pictures


@dataclass(frozen=True)
class _Block:
    """One view, ready to be drawn: pictures in [0, 1], truth first; errors of the renders."""

    name: str
    pictures: list[Float[np.ndarray, "H W 3"]]
    errors: list[Float[np.ndarray, "H W"]]
    psnr: list[float]
    box: Box
    shown: Panel


def contact_sheet(columns: Sequence[SheetColumn], truth: Pictures, views: int = 3, title: str = "") -> Image.Image:
    """One picture of the ``views`` views on which the columns differ most; the first column is the truth.

    Raises:
        RunError: no columns, or no view that all columns and the truth have, or sizes that differ within a view.
    """
    if not columns:
        raise RunError("a contact sheet needs the pictures of at least one run; make them with 'ringlight eval RUN'")
    names = choose_views([column.images for column in columns], truth, views)
    blocks = [_block(name, columns, truth) for name in names]
    top = scale_top([error for block in blocks for error in block.errors])
    pitch = max(block.shown.width for block in blocks) + GAP
    header = round(LINE * LABEL_SIZE) + (round(LINE * TITLE_SIZE) if title else 0)
    width = 2 * MARGIN - GAP + pitch * (len(columns) + 1)
    about = wrapped(f"{ABOUT}, scale up to {top:g}.", SMALL_SIZE, width - 2 * MARGIN)
    caption, footer = round(LINE * TEXT_SIZE), round(LINE * SMALL_SIZE) * len(about)
    height = 2 * MARGIN + header + sum(caption + block.shown.total_height + BLOCK_GAP for block in blocks) + footer
    sheet = Image.new("RGB", (width, height), PAPER)
    pen = _Pen(sheet)
    if title:
        pen.text((MARGIN, MARGIN), title, TITLE_SIZE, INK, sheet.width - 2 * MARGIN)
    for index, label in enumerate(["ground truth", *(column.label for column in columns)]):
        pen.text(
            (MARGIN + index * pitch, MARGIN + header - round(LINE * LABEL_SIZE)), label, LABEL_SIZE, INK, pitch - GAP
        )
    y = MARGIN + header
    for block in blocks:
        _draw_block(pen, block, (MARGIN, y), pitch, top)
        _draw_scale(pen, block.shown, (MARGIN, y + caption), top)
        y += caption + block.shown.total_height + BLOCK_GAP
    for number, line in enumerate(about):
        pen.text((MARGIN, y + number * round(LINE * SMALL_SIZE)), line, SMALL_SIZE, FAINT, sheet.width - 2 * MARGIN)
    return sheet


def _block(name: str, columns: Sequence[SheetColumn], truth: Pictures) -> _Block:
    target, renders = truth[name], [column.images[name] for column in columns]
    height, width = target.shape[:2]
    shown = panel(width, height, len(columns) + 1)
    pictures = [pixels(image) for image in (target, *renders)]
    errors = [np.abs(picture - pictures[0]).mean(-1) for picture in pictures[1:]]
    box = choose_box(difference_map(renders, target), *box_size(shown, width))
    return _Block(name, pictures, errors, [metrics.psnr(image, target) for image in renders], box, shown)


def scale_top(errors: Sequence[Float[np.ndarray, "_ _"]]) -> float:
    """Where the scale of these error maps ends: a number that one can read, above nearly all of their values."""
    bound = float(np.quantile(np.concatenate([error.ravel() for error in errors]), SCALE_QUANTILE))
    return next((top for top in SCALE_TOPS if top >= bound), SCALE_TOPS[-1])


def _draw_block(pen: "_Pen", block: _Block, corner: tuple[int, int], pitch: int, top: float) -> None:
    best = max(block.psnr)
    y = corner[1] + round(LINE * TEXT_SIZE)
    for index, picture in enumerate(block.pictures):
        x = corner[0] + index * pitch
        if index == 0:
            pen.text((x, corner[1]), block.name, TEXT_SIZE, FAINT, block.shown.width)
        else:
            psnr = block.psnr[index - 1]
            is_best = psnr == best and len(block.psnr) > 1
            pen.text((x, corner[1]), _decibels(psnr), TEXT_SIZE, BEST if is_best else INK, block.shown.width)
        whole = _to_8bit(picture).resize((block.shown.width, block.shown.height), Image.Resampling.LANCZOS)
        pen.picture((x, y), whole, FRAME)
        pen.box((x, y), block)
        half_y = y + block.shown.height + INNER_GAP
        pen.picture((x, half_y), _enlarged(picture, block), MARK)
        if index > 0:
            error = _resized_error(block.errors[index - 1], block.shown.half)
            right = x + block.shown.width - block.shown.half[0]
            pen.picture((right, half_y), Image.fromarray(ember(error / top)), FRAME)


def _decibels(psnr: float) -> str:
    return "identical" if math.isinf(psnr) else f"{psnr:.2f} dB"


def _draw_scale(pen: "_Pen", shown: Panel, corner: tuple[int, int], top: float) -> None:
    """The colour bar of the error maps, where the photograph's own error map would be."""
    width, height = shown.half
    left = corner[0] + shown.width - width
    first = corner[1] + shown.height + INNER_GAP
    text_height = round(LINE * SMALL_SIZE)
    bar_width, bar_height = max(width // 12, 8), height - text_height
    ramp = np.linspace(1, 0, max(bar_height, 2))[:, None].repeat(bar_width, 1)
    pen.text((left, first - 2), "error", SMALL_SIZE, FAINT, width)
    pen.picture((left, first + text_height), Image.fromarray(ember(ramp)), FRAME)
    for part in (0.0, 0.5, 1.0):
        y = first + text_height + round((1 - part) * (bar_height - SMALL_SIZE - 2))
        pen.text((left + bar_width + INNER_GAP, y), f"{part * top:g}", SMALL_SIZE, FAINT, width - bar_width)


def _enlarged(picture: Float[np.ndarray, "H W 3"], block: _Block) -> Image.Image:
    box = block.box
    part = picture[box.top : box.top + box.height, box.left : box.left + box.width]
    return _to_8bit(part).resize(block.shown.half, Image.Resampling.NEAREST)


def _resized_error(error: Float[np.ndarray, "H W"], size: tuple[int, int]) -> Float[np.ndarray, "h w"]:
    # Averages errors, not colours; BOX never leaves the range of its input.
    return np.asarray(Image.fromarray(error.astype(np.float32)).resize(size, Image.Resampling.BOX))


def _to_8bit(picture: Float[np.ndarray, "H W 3"]) -> Image.Image:
    return Image.fromarray(np.rint(picture * 255).astype(np.uint8))


class _Pen:
    """Draws text, framed pictures and boxes on one sheet."""

    def __init__(self, sheet: Image.Image) -> None:
        self.sheet = sheet
        self.draw = ImageDraw.Draw(sheet)

    def text(self, corner: tuple[int, int], text: str, size: int, color: str, width: int) -> None:
        """One line from its top left corner, cut to ``width``."""
        self.draw.text(corner, cut(text, size, width), fill=color, font=ImageFont.load_default(size))

    def picture(self, corner: tuple[int, int], picture: Image.Image, frame: str) -> None:
        self.sheet.paste(picture, corner)
        self.draw.rectangle(_around(corner, picture.size), outline=frame)

    def box(self, corner: tuple[int, int], block: _Block) -> None:
        """The marked box on a full picture."""
        height, width = block.pictures[0].shape[:2]
        across, down = block.shown.width / width, block.shown.height / height
        left, top = corner[0] + round(block.box.left * across), corner[1] + round(block.box.top * down)
        size = round(block.box.width * across), round(block.box.height * down)
        self.draw.rectangle(_around((left, top), size), outline=MARK, width=2)


def _around(corner: tuple[int, int], size: tuple[int, int]) -> tuple[int, int, int, int]:
    """One pixel outside of a rectangle, so that a frame hides nothing."""
    return corner[0] - 1, corner[1] - 1, corner[0] + size[0], corner[1] + size[1]
