"""Where methods differ most: which views and which boxes of them are worth a reader's look. Always the same choice."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Protocol, runtime_checkable

import numpy as np
from jaxtyping import Float
from torch import Tensor

from ringlight.errors import RunError


@runtime_checkable
class Pictures(Protocol):
    """Pictures by the name of their view, in [0, 1]: a dictionary, or files that are decoded when asked for."""

    def __getitem__(self, view: str, /) -> Float[Tensor, "H W 3"]:
        """The picture of a view."""
        ...

    def __iter__(self) -> Iterator[str]:
        """The names of the views."""
        ...

    def __contains__(self, view: object, /) -> bool:
        """Whether there is a picture of the view."""
        ...


SCORE_SIDE = 400
"""Views are ranked on every n-th pixel, about this many a side: hundreds of large pictures take seconds so."""


@dataclass(frozen=True)
class Box:
    """A rectangle of pixels: first column and row, width and height."""

    left: int
    top: int
    width: int
    height: int


def pixels(image: Float[Tensor, "H W 3"]) -> Float[np.ndarray, "H W 3"]:
    """A picture as numbers in [0, 1]; undefined values are black."""
    return np.clip(np.nan_to_num(image.detach().cpu().double().numpy(), nan=0.0), 0, 1)


def difference_map(
    renders: Sequence[Float[Tensor, "H W 3"]], truth: Float[Tensor, "H W 3"]
) -> Float[np.ndarray, "H W"]:
    """How far apart the renders are at each pixel: largest minus smallest value, mean over channels.

    A single render is held against the truth.
    """
    stack = np.stack([pixels(image) for image in (renders if len(renders) > 1 else [*renders, truth])])
    spread: Float[np.ndarray, "H W"] = (stack.max(0) - stack.min(0)).mean(-1)
    return spread


def choose_views(columns: Sequence[Pictures], truth: Pictures, count: int) -> list[str]:
    """The ``count`` views on which the columns differ most on average, most first; ties by name.

    Raises:
        RunError: no view is in every column and in the truth, or sizes differ within a view.
    """
    names = sorted(name for name in truth if all(name in column for column in columns))
    if not names:
        raise RunError("the runs have no test picture in common; make them with 'ringlight eval RUN'")
    score = {name: _coarse_difference(name, [column[name] for column in columns], truth[name]) for name in names}
    return sorted(names, key=lambda name: (-score[name], name))[:count]


def _coarse_difference(name: str, renders: Sequence[Tensor], truth: Tensor) -> float:
    sizes = [f"{image.shape[1]}x{image.shape[0]}" for image in (truth, *renders)]
    if len(set(sizes)) > 1:
        raise RunError(f"view {name}: its pictures differ in size ({', '.join(sizes)}); evaluate all runs anew")
    step = max(1, max(truth.shape[:2]) // SCORE_SIDE)
    return float(difference_map([image[::step, ::step] for image in renders], truth[::step, ::step]).mean())


def choose_box(difference: Float[np.ndarray, "H W"], width: int, height: int) -> Box:
    """The box of this size with the largest sum; the first from the top left among equals."""
    rows, columns = difference.shape
    width, height = min(width, columns), min(height, rows)
    corner_sums = np.zeros((rows + 1, columns + 1))
    corner_sums[1:, 1:] = difference.cumsum(0).cumsum(1)
    sums = (
        corner_sums[height:, width:]
        - corner_sums[:-height, width:]
        - corner_sums[height:, :-width]
        + corner_sums[:-height, :-width]
    )
    top, left = np.unravel_index(np.argmax(sums), sums.shape)
    return Box(int(left), int(top), width, height)
