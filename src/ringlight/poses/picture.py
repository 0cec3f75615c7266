"""One picture of cameras and points, from above and from the side, to see at a glance whether they make sense."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float
from PIL import Image, ImageDraw, ImageFont

PAPER, INK, FAINT, CAMERA, FIRST = "#ffffff", "#1c1f26", "#7a808c", "#0b5fa5", "#d1495b"

SIDE, MARGIN, TEXT = 640, 24, 15
"""Pixels: of one view, around it, and of letters."""

ROOM = 1.15
"""Half of what a view shows, over the farthest camera's distance from the middle."""

ARROW = 0.07
"""Length of a camera's viewing direction, over half of what a view shows."""

MOST_POINTS = 60_000


@dataclass(frozen=True)
class Found:
    """What is drawn, world units with z up: cameras in the order of their names, and points with colours 0 to 1."""

    centers: Float[np.ndarray, "V 3"]
    forward: Float[np.ndarray, "V 3"]
    points: Float[np.ndarray, "P 3"]
    colors: Float[np.ndarray, "P 3"]


def draw_cameras(found: Found, title: str) -> Image.Image:
    """Points in their colours, cameras as dots with a line towards what they look at; the first is red."""
    sheet = Image.new("RGB", (2 * SIDE + 3 * MARGIN, SIDE + 3 * MARGIN + 2 * TEXT), PAPER)
    pen = ImageDraw.Draw(sheet)
    font = ImageFont.load_default(TEXT)
    pen.text((MARGIN, MARGIN // 2), title, INK, font)
    middle = np.median(found.points, axis=0) if len(found.points) else found.centers.mean(0)
    half = ROOM * max(float(np.abs(found.centers - middle).max()), 1e-6)
    for column, (label, axes) in enumerate((("from above", (0, 1)), ("from the side", (0, 2)))):
        left, top = MARGIN + column * (SIDE + MARGIN), MARGIN + 2 * TEXT
        sheet.paste(_view(found, middle, half, axes), (left, top))
        pen.rectangle((left, top, left + SIDE, top + SIDE), outline=FAINT)
        pen.text((left, top + SIDE + 4), label, FAINT, font)
    return sheet


def _view(found: Found, middle: Float[np.ndarray, "3"], half: float, axes: tuple[int, int]) -> Image.Image:
    def places(world: Float[np.ndarray, "N 3"]) -> Float[np.ndarray, "N 2"]:
        flat = (world - middle)[:, axes] / half
        return (flat * [1, -1] + 1) * SIDE / 2

    pixels = np.full((SIDE, SIDE, 3), 255, np.uint8)
    # The farthest first, so that what is nearer to the onlooker is seen.
    depth = found.points[:, 2] if axes == (0, 1) else -found.points[:, 1]
    order = np.argsort(depth, kind="stable")[-MOST_POINTS:]
    spots = np.floor(places(found.points[order])).astype(int)
    inside = ((spots >= 0) & (spots < SIDE)).all(1)
    column, row = spots[inside].T
    pixels[row, column] = np.round(np.clip(found.colors[order][inside], 0, 1) * 255).astype(np.uint8)
    view = Image.fromarray(pixels)
    pen = ImageDraw.Draw(view)
    starts, ends = places(found.centers), places(found.centers + ARROW * half * found.forward)
    for index in reversed(range(len(starts))):
        (x, y), color = starts[index], FIRST if index == 0 else CAMERA
        pen.line((x, y, *ends[index]), fill=color, width=2)
        pen.ellipse((x - 3, y - 3, x + 3, y + 3), fill=color)
    return view
