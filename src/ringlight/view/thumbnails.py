"""Small photographs for the cameras, decoded one by one while nothing else is to be done."""

import numpy as np
import torch
from torch.nn.functional import interpolate

from ringlight.errors import RinglightError
from ringlight.view.page import Page
from ringlight.view.subject import Subject

SIDE = 96
"""Pixels of the longer side: a few kilobytes each."""


class Thumbnails:
    """Of the photographs whose cameras are drawn, each once; to decode all of a large scene takes minutes."""

    def __init__(self, subject: Subject):
        drawn = [name for name in subject.drawn_views if name in subject.photographs]
        self._left = [(name, subject.photographs[name]) for name in reversed(drawn)]

    def hang_one(self, page: Page) -> bool:
        """The next; whether there was one. A photograph that cannot be decoded is passed over: it is told of where
        somebody goes to it."""
        if not self._left:
            return False
        name, load = self._left.pop()
        try:
            photograph = load()
        except RinglightError:
            return True
        factor = SIDE / max(photograph.shape[1:])
        sides = tuple(max(round(side * factor), 1) for side in photograph.shape[1:])
        small = interpolate(photograph[None], sides, mode="bilinear", antialias=True, align_corners=False)[0]
        picture: np.ndarray = (small.clamp(0, 1).permute(1, 2, 0) * 255 + 0.5).to(torch.uint8).contiguous().numpy()
        page.thumbnail(name, picture)
        return True
