"""Sizes on a contact sheet: how large pictures are shown, and where the parts of one view go. All in pixels."""

from dataclasses import dataclass

PAPER = "#ffffff"

MAX_WIDTH = 2400
"""Of the whole sheet: fits a large screen at 1:1."""
MARGIN = 28
GAP = 18
"""Between columns."""
INNER_GAP = 8
"""Between a picture, its enlarged box and its error map."""
MAX_SIDE = 640
"""Larger pictures are shrunk to this."""
GROWN_SIDE = 480
"""Small pictures grow by a whole factor up to this."""
MIN_SIDE = 96
"""With very many columns the sheet gets wider than MAX_WIDTH rather than pictures smaller than this."""

BOX_PART = 0.25
"""The enlarged box is about this part of the picture's width."""
MIN_ZOOM = 2
"""Of the box, in pixels of the sheet per pixel of the picture."""
SMALLEST_BOX_PART = 0.12
"""Narrow columns show large pictures at 1:1 rather than a box so small that it says nothing."""


@dataclass(frozen=True)
class Panel:
    """One picture on the sheet and the two halves below it (enlarged box, error map)."""

    width: int
    height: int

    @property
    def half(self) -> tuple[int, int]:
        """Width and height of a half, in the picture's proportions."""
        width = (self.width - INNER_GAP) // 2
        return max(width, 1), max(round(width * self.height / self.width), 1)

    @property
    def total_height(self) -> int:
        """Picture, gap and halves."""
        return self.height + INNER_GAP + self.half[1]


def panel(width: int, height: int, columns: int) -> Panel:
    """How large a picture of ``width`` x ``height`` is shown on a sheet of so many columns."""
    room = (MAX_WIDTH - 2 * MARGIN - (columns - 1) * GAP) // columns
    limit = max(MIN_SIDE, min(MAX_SIDE, room))
    side = max(width, height)
    scale = limit / side if side > limit else max(1, min(GROWN_SIDE, limit) // side)
    return Panel(max(round(width * scale), 1), max(round(height * scale), 1))


def box_size(shown: Panel, width: int) -> tuple[int, int]:
    """Pixels of a picture of this width that fill a half of its panel at a whole magnification."""
    half_width, half_height = shown.half
    zoom = max(MIN_ZOOM, round(half_width / (width * BOX_PART)))
    if half_width < zoom * width * SMALLEST_BOX_PART:
        zoom = 1
    return max(half_width // zoom, 1), max(half_height // zoom, 1)
