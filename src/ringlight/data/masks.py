"""Masks that lie in files of their own: found by their photographs' names, checked, and said.

A mask is white where the subject is, and becomes the photograph's alpha: what is black counts as background. COLMAP
calls the mask of ``images/a.jpg`` ``masks/a.jpg.png``, Brush also ``masks/a.png``; nerfstudio names it in the frame.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from jaxtyping import UInt8

from ringlight.core.words import counted
from ringlight.data.folder import IMAGE_SUFFIXES, first_inside, shown
from ringlight.data.frame import Frame
from ringlight.data.mask_files import MaskFile
from ringlight.data.options import FOUND, UNUSED, ReadingOptions
from ringlight.errors import SceneError

USUAL_FOLDER = "masks"
"""Beside the photographs' folder."""

PROBES = 12
"""Masks that are looked at before training, evenly chosen."""

BORDER_KEPT, MIDDLE_KEPT = 0.8, 0.3
"""Least share of its border, most of its middle third, that a mask keeps which was probably meant the other way."""

KEPT = 127
"""Of 255; above it a pixel counts as kept."""


@dataclass(frozen=True)
class Masked:
    """Frames with their masks, and notes on these."""

    frames: list[Frame]
    notes: tuple[str, ...]


def with_masks(frames: Sequence[Frame], folder: Path, options: ReadingOptions) -> Masked:
    """The frames of a scene with the masks that ``options`` ask for; a photograph without one is all subject, where
    others have one.

    Raises:
        SceneError: the folder asked for has no mask, a mask is none of its photograph, cannot be read, or all are
            black.
    """
    place = _folder(folder, options)
    if options.masks == UNUSED:
        has_some = place is not None or any(frame.named_mask for frame in frames)
        return Masked(list(frames), ("masks: those of the scene are not used, as --masks none asks",) * has_some)
    if options.masks == FOUND and any(frame.named_mask for frame in frames):
        masks, label = [frame.named_mask.path() if frame.named_mask else None for frame in frames], "mask_path"
    elif place is not None:
        masks, label = _of_folder(frames, place), f"{_below(place, folder)}/"
    else:
        masks, label = [None] * len(frames), ""
    found = sum(mask is not None for mask in masks)
    if not found:
        return Masked(list(frames), _none_found(place, folder, frames, options))
    masked = [
        replace(frame, mask=MaskFile(mask, options.invert_masks and mask is not None))
        for frame, mask in zip(frames, masks, strict=True)
    ]
    for frame in masked:
        _check_size(frame, folder)
    inverted = ", inverted" if options.invert_masks else ""
    note = f"masks: {label} ({found} of {counted(len(frames), 'photograph')}{inverted})"
    if found < len(frames):
        first = next(frame.name for frame, mask in zip(frames, masks, strict=True) if mask is None)
        note = f"warning: {note}; the others, as {first}, count as all subject"
    return Masked(masked, (note, *_doubts(masked, folder)))


def _folder(folder: Path, options: ReadingOptions) -> Path | None:
    """Where masks may lie. Raises SceneError where the user names no folder."""
    if options.masks in (FOUND, UNUSED):
        usual = folder / USUAL_FOLDER
        return usual if usual.is_dir() else None
    place = folder / options.masks if (folder / options.masks).is_dir() else Path(options.masks)
    if not place.is_dir():
        raise SceneError(f"{place}: no such folder; give --masks a folder of masks, or none")
    return place


def _of_folder(frames: Sequence[Frame], place: Path) -> list[Path | None]:
    names = [frame.name for frame in frames]
    tops = {name.partition("/")[0] if "/" in name else "" for name in names}
    within = f"{tops.pop()}/" if len(tops) == 1 and "" not in tops else ""
    return [_mask_called(place, name) or _mask_called(place, name.removeprefix(within)) for name in names]


def _mask_called(place: Path, name: str) -> Path | None:
    stem = name.rpartition(".")[0] or name
    return first_inside(place, [f"{name}.png", name, *(stem + suffix for suffix in IMAGE_SUFFIXES)], str(place))


def _none_found(place: Path | None, folder: Path, frames: Sequence[Frame], options: ReadingOptions) -> tuple[str, ...]:
    if place is None:
        if options.invert_masks:
            raise SceneError(f"{folder}: has no masks that --invert-masks could invert; give --masks FOLDER")
        return ()
    example = f"{frames[0].name}.png" if frames else "NAME.png"
    if options.masks == FOUND and not options.invert_masks:
        return (f"warning: masks: none in {_below(place, folder)}/ is called like a photograph, as {example} would be",)
    raise SceneError(f"{place}: holds no mask that is called like a photograph; call that of the first {example}")


def _check_size(frame: Frame, folder: Path) -> None:
    if frame.mask is None or frame.mask.path is None:
        return
    if frame.mask.path == frame.path:
        raise SceneError(f"{folder}: {frame.name} would be its own mask; give --masks a folder of masks, or none")
    if not frame.mask.path.is_file():
        path = _below(frame.mask.path, folder)
        raise SceneError(
            f"{folder}: the mask {shown(path)} of {frame.name} is missing; copy it there, or give --masks none"
        )
    frame.mask.refuse_other_size(frame.header.width, frame.header.height, frame.name)


def _below(path: Path, folder: Path) -> str:
    """Below the scene's folder, or whole."""
    try:
        return path.resolve().relative_to(folder.resolve()).as_posix()
    except ValueError:
        return str(path)


def _doubts(frames: Sequence[Frame], folder: Path) -> Iterator[str]:
    """Warnings of masks that were probably not meant so. Raises SceneError where all that are looked at are black."""
    own = [frame for frame in frames if frame.mask and frame.mask.path]
    chosen = [own[index] for index in np.linspace(0, len(own) - 1, min(len(own), PROBES)).astype(int)]
    kept = [_pixels(frame) > KEPT for frame in chosen]
    black = [frame.name for frame, mask in zip(chosen, kept, strict=True) if not mask.any()]
    if len(black) == len(chosen):
        raise SceneError(
            f"{folder}: the masks keep nothing: all that were looked at, as that of {black[0]}, are black all over; "
            "make them white where the subject is, or give --masks none"
        )
    if black:
        yield f"warning: the masks of {len(black)} of {len(chosen)} photographs looked at are black, as of {black[0]}"
    turned, around = (sum(keeps(mask) for mask in kept) for keeps in (_keeps_border_alone, _keeps_border))
    if 2 * turned > len(chosen):
        remedy = "leave --invert-masks out" if own[0].mask and own[0].mask.is_inverted else "give --invert-masks"
        yield (
            f"warning: masks keep the borders of their photographs and drop the middle ({turned} of {len(chosen)} "
            f"looked at); if they are meant the other way round, {remedy}"
        )
    elif 2 * around > len(chosen):
        yield (
            f"masks keep the borders of their photographs ({around} of {len(chosen)} looked at), and what they drop "
            "counts as background; if it only disturbs, give --masks none"
        )


def _pixels(frame: Frame) -> UInt8[np.ndarray, "H W"]:
    assert frame.mask is not None
    return np.asarray(frame.mask.alpha((frame.header.width, frame.header.height)))


def _keeps_border(kept: np.ndarray) -> bool:
    """And drops something."""
    border = np.concatenate([kept[0], kept[-1], kept[:, 0], kept[:, -1]])
    return bool(border.mean() >= BORDER_KEPT and not kept.all())


def _keeps_border_alone(kept: np.ndarray) -> bool:
    height, width = kept.shape
    middle = kept[height // 3 : -(-2 * height // 3), width // 3 : -(-2 * width // 3)]
    return _keeps_border(kept) and bool(middle.mean() <= MIDDLE_KEPT)
