"""Two or more pictures in one window: each its own part of it, drawn no larger than it is seen."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import torch
from jaxtyping import Float
from torch import Tensor

from ringlight.core.camera import Camera

LINE = 0.0
"""Gray of the line between two parts, one pixel wide."""


@dataclass(frozen=True)
class Pane:
    """A part of the window, from the left: which source it shows, and the camera of its pixels."""

    source: str
    camera: Camera


def behind_curtain(camera: Camera, left: str, right: str, place: float) -> list[Pane]:
    """The left source up to the share ``place`` of the window's width, the right one beyond; one view of the two."""
    cut = round(min(max(place, 0.0), 1.0) * camera.width)
    parts = [(left, 0, cut), (right, cut, camera.width)]
    return [Pane(source, _columns(camera, begin, end)) for source, begin, end in parts if end > begin]


def side_by_side(camera: Camera, sources: Sequence[str]) -> list[Pane]:
    """All sources, each in a strip that shows the middle of the view."""
    count = min(len(sources), camera.width)
    edges = [index * camera.width // count for index in range(count + 1)]
    panes = []
    for source, begin, end in zip(sources, edges, edges[1:], strict=False):
        width = end - begin
        shift = (camera.width - width) / 2
        panes.append(Pane(source, replace(camera, width=width, center=(camera.center[0] - shift, camera.center[1]))))
    return panes


def joined(pictures: Sequence[Float[Tensor, "H _ 3"]]) -> Float[Tensor, "H W 3"]:
    """The panes' pictures as one, with a line where one ends."""
    whole = torch.cat(list(pictures), 1)
    at = 0
    for picture in pictures[:-1]:
        at += picture.shape[1]
        whole[:, at - 1] = LINE
    return whole


def _columns(camera: Camera, begin: int, end: int) -> Camera:
    return replace(camera, width=end - begin, center=(camera.center[0] - begin, camera.center[1]))
