"""One view for the eye: a model's normals, the true ones, and the angle between them as colours of one fixed scale."""

import numpy as np
from jaxtyping import Bool, Float, UInt8
from PIL import Image, ImageDraw, ImageFont

from ringlight.measure.colormap import ember
from ringlight.measure.normal_error import COVERED, ComparedNormals, NormalScore
from ringlight.measure.sheet_layout import GAP, MARGIN, PAPER, panel
from ringlight.measure.sheet_text import cut

TOP = 45.0
"""Degrees where the scale ends, in every picture, so that pictures of several models can be compared. What is farther
off is plainly wrong."""

TICKS = (0, 15, 30, 45)
"""Degrees that the scale names."""

LACKING = (74, 158, 199)
"""Where there is a true normal and none of the model's: a blue that the scale does not have."""

NOTHING = (213, 216, 222)
"""Where there is no true normal: apart from the scale's bright end."""

INK, FAINT, FRAME = "#1c1f26", "#7a808c", "#d5d8de"

TEXT_SIZE, SMALL_SIZE = 16, 13
LINE = 1.6
"""Height of a line of text over the size of its letters."""

NARROWEST = 260
"""Pixels of a column: room for the texts above and below a picture that is narrower."""

BAR = 14
"""Pixels: height of the scale."""

SCALE_NOTE = "degrees; blue: the model shows no surface"


def normal_picture(view: ComparedNormals, name: str, score: NormalScore) -> Image.Image:
    """Three panels with their titles, and the scale below the last.

    Normals are world axes as red, green and blue around middle gray, over white, as of ``ringlight render --layers
    normal``.
    """
    height, width = view.angles.shape
    shown = panel(width, height, 3)
    own = _directions(view.normals, _covered(view))
    panels = (own, _directions(view.truth, np.linalg.norm(view.truth, axis=-1) > 0), _angles(view))
    titles = (f"model: {name}", "true normals", f"angle: {_summary(score)}")
    caption, small = round(LINE * TEXT_SIZE), round(LINE * SMALL_SIZE)
    pitch = max(shown.width, NARROWEST) + GAP
    size = (2 * MARGIN + 3 * pitch - GAP, 2 * MARGIN + caption + shown.height + GAP + BAR + 2 * small)
    sheet = Image.new("RGB", size, PAPER)
    pen = ImageDraw.Draw(sheet)
    for index, (pixels, title) in enumerate(zip(panels, titles, strict=True)):
        x = MARGIN + index * pitch
        line = cut(title, TEXT_SIZE, pitch - GAP)
        pen.text((x, MARGIN), line, fill=INK, font=ImageFont.load_default(TEXT_SIZE))
        y = MARGIN + caption
        pen.rectangle((x - 1, y - 1, x + shown.width, y + shown.height), outline=FRAME)
        sheet.paste(Image.fromarray(pixels).resize((shown.width, shown.height), Image.Resampling.NEAREST), (x, y))
    _draw_scale(sheet, (MARGIN + 2 * pitch, MARGIN + caption + shown.height + GAP), pitch - GAP)
    return sheet


def _summary(score: NormalScore) -> str:
    if score.mean is None:
        return "nothing to compare"
    return f"mean {score.mean:.1f}, median {score.median:.1f} deg"


def _covered(view: ComparedNormals) -> Bool[np.ndarray, "H W"]:
    covered: np.ndarray = (view.alpha[..., 0] >= COVERED) & np.isfinite(view.normals).all(-1)
    return covered


def _directions(normals: Float[np.ndarray, "H W 3"], there: Bool[np.ndarray, "H W"]) -> UInt8[np.ndarray, "H W 3"]:
    colors = np.where(there[..., None], 0.5 + 0.5 * normals, 1.0)
    return np.rint(np.nan_to_num(colors, nan=1.0).clip(0, 1) * 255).astype(np.uint8)


def _angles(view: ComparedNormals) -> UInt8[np.ndarray, "H W 3"]:
    colors = ember(view.angles / TOP)
    colors[np.isnan(view.angles)] = LACKING
    colors[~view.truth.any(-1)] = NOTHING
    return colors


def _draw_scale(sheet: Image.Image, corner: tuple[int, int], width: int) -> None:
    """Under the angles: a bar with degrees, and what the blue means."""
    pen, font = ImageDraw.Draw(sheet), ImageFont.load_default(SMALL_SIZE)
    x, y = corner
    ramp = np.linspace(0, 1, width)[None].repeat(BAR, 0)
    sheet.paste(Image.fromarray(ember(ramp)), corner)
    pen.rectangle((x - 1, y - 1, x + width, y + BAR), outline=FRAME)
    for degrees in TICKS:
        text = f"{degrees}" if degrees < TOP else f"{degrees}+"
        at = (width - font.getlength(text)) if degrees == TOP else degrees / TOP * width
        pen.text((x + at, y + BAR + 4), text, fill=FAINT, font=font)
    pen.text((x, y + BAR + 4 + round(LINE * SMALL_SIZE)), SCALE_NOTE, fill=FAINT, font=font)
