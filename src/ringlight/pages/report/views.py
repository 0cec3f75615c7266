"""Test views on the page: the worst, the best and some between, each as photographed and as every run shows it."""

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from jaxtyping import Float, UInt8

from ringlight.core.words import counted
from ringlight.errors import RunError
from ringlight.measure.compare import ComparedRun
from ringlight.measure.contact_sheet import scale_top
from ringlight.measure.picture_names import RENDERS, TRUTHS
from ringlight.measure.pictures import PictureFolder, read_pixels
from ringlight.pages.report.encoded import MOST_SIDE, error_url, picture_url
from ringlight.pages.report.groups import Group, Member

MOST_BYTES = 24_000_000
"""Of the pictures of all test views on a page: beyond this, views are left out and the page says so."""

KEPT_BYTES = 256_000_000
"""Of decoded pictures that are kept: a hundred of a megapixel."""


@dataclass(frozen=True)
class RunPicture:
    """What one run shows of a view: its PSNR in dB, its picture and its error map as data URLs."""

    member: Member
    psnr: float
    picture: str
    error: str


@dataclass(frozen=True)
class ViewShown:
    """``rank`` 0 is the worst of ``of`` views; ``width`` and ``height`` of the photograph as the page holds it."""

    name: str
    rank: int
    of: int
    width: int
    height: int
    photograph: str
    runs: tuple[RunPicture, ...]

    @property
    def bytes(self) -> int:
        """Of its pictures."""
        return len(self.photograph) + sum(len(run.picture) + len(run.error) for run in self.runs)


@dataclass(frozen=True)
class ViewsShown:
    """``top``: the error at which the scale of all maps ends, in [0, 1]. ``notes``: what is not shown, and why."""

    views: tuple[ViewShown, ...]
    top: float
    notes: tuple[str, ...]


def ranked(group: Group) -> list[str]:
    """The views of all of a group's runs by their mean PSNR, the worst first; ties by name."""
    scores: dict[str, list[float]] = {}
    for _, run in group.measured:
        for image in run.report.images:
            scores.setdefault(image.name, []).append(image.psnr)
    return sorted(scores, key=lambda name: (sum(scores[name]) / len(scores[name]), name))


def chosen(count: int, of: int) -> list[int]:
    """Ranks of the views that are shown: a third of them the worst, a third the best, the others between at even
    distances."""
    if count >= of:
        return list(range(of))
    best = count // 3
    worst = max(best, 1)
    between = count - worst - best
    left = of - worst - best
    middle = [worst + (2 * index + 1) * left // (2 * between) for index in range(between)]
    return [*range(worst), *middle, *range(of - best, of)]


def views_shown(group: Group, count: int, room: int) -> ViewsShown:
    """Up to ``count`` views in ``room`` bytes; pictures that are missing or damaged become notes."""
    notes: list[str] = []
    folders = [(member, run, run.pictures(RENDERS), run.pictures(TRUTHS)) for member, run in group.measured]
    whole = [(member, run, renders) for member, run, renders, truths in folders if renders and truths]
    for _, run, renders, truths in folders:
        if run.report.images and not (renders and truths):
            notes.append(f"{run.folder} has no pictures of its test views; 'ringlight eval' makes them.")
    if not whole or not count:
        return ViewsShown((), 1.0, tuple(notes))
    photographs = next(truths for _, _, renders, truths in folders if renders and truths)
    names = [name for name in ranked(group) if name in photographs and all(name in r for _, _, r in whole)]
    ranks = chosen(count, len(names))
    errors, readable, decoded = [], [], _Decoded()
    for rank in ranks:
        try:
            errors.append(_thinned(_errors(names[rank], photographs, whole, decoded)))
            readable.append(rank)
        except RunError as error:
            notes.append(f"{error}.")
    top = scale_top(errors) if errors else 1.0
    shown: dict[int, ViewShown] = {}
    # From both ends inwards: where there is no room for all, the worst and the best are what one looks for.
    for rank in sorted(readable, key=lambda rank: min(rank, len(names) - 1 - rank)):
        view = _view(names[rank], rank, len(names), photographs, whole, top, decoded)
        room -= view.bytes
        if room < 0 and shown:
            left_out = counted(len(readable) - len(shown), "view")
            notes.append(f"{group.scene}: {left_out} of {len(readable)} left out, else the page would be too large.")
            break
        shown[rank] = view
    return ViewsShown(tuple(shown[rank] for rank in sorted(shown)), top, tuple(notes))


_Whole = Sequence[tuple[Member, ComparedRun, PictureFolder]]


class _Decoded:
    """Pictures by folder and view, decoded once while all that were fit into KEPT_BYTES: the scale of the error maps
    wants each before any is shown."""

    def __init__(self) -> None:
        self._kept: dict[Path, UInt8[np.ndarray, "H W 3"]] = {}
        self._room = KEPT_BYTES

    def __call__(self, pictures: PictureFolder, name: str) -> UInt8[np.ndarray, "H W 3"]:
        """Raises RunError for a damaged file."""
        path = pictures.paths[name]
        if path in self._kept:
            return self._kept[path]
        pixels = read_pixels(path)
        if pixels.nbytes <= self._room:
            self._room -= pixels.nbytes
            self._kept[path] = pixels
        return pixels


def _errors(
    name: str, photographs: PictureFolder, whole: _Whole, decoded: _Decoded
) -> Iterator[Float[np.ndarray, "H W"]]:
    """Mean over the channels of the difference to the photograph, of one run after the other: pictures may be of a
    hundred megapixels, and runs many."""
    truth = decoded(photographs, name)
    for _, _, renders in whole:
        render = decoded(renders, name)
        sizes = {f"{picture.shape[1]}x{picture.shape[0]}" for picture in (truth, render)}
        if len(sizes) > 1:
            told = ", ".join(sorted(sizes))
            raise RunError(f"view {name}: its pictures differ in size ({told}); evaluate all runs anew")
        apart = np.abs(np.subtract(render, truth, dtype=np.int16)).sum(-1, dtype=np.int32)
        yield apart.astype(np.float32) / np.float32(3 * 255)


def _thinned(errors: Iterable[Float[np.ndarray, "H W"]]) -> Float[np.ndarray, "K n"]:
    """Every n-th pixel: enough to choose a scale, of hundreds of large pictures too."""
    thin = []
    for error in errors:
        step = -(-max(error.shape) // MOST_SIDE)
        thin.append(error[::step, ::step].flatten())  # a copy: a view of it would keep the whole alive
    return np.stack(thin)


def _view(
    name: str, rank: int, of: int, photographs: PictureFolder, whole: _Whole, top: float, decoded: _Decoded
) -> ViewShown:
    truth = decoded(photographs, name)
    errors = _errors(name, photographs, whole, decoded)
    runs = []
    for (member, run, renders), error in zip(whole, errors, strict=True):
        psnr = next(image.psnr for image in run.report.images if image.name == name)
        runs.append(RunPicture(member, psnr, picture_url(decoded(renders, name)), error_url(error, top)))
    return ViewShown(name, rank, of, truth.shape[1], truth.shape[0], picture_url(truth), tuple(runs))
