"""What a format finds in a folder, and how it becomes a Scene: the part that all formats share."""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

from ringlight.core.camera import picture_sizes
from ringlight.core.memory import machine_memory
from ringlight.core.scene import PointCloud, Scene, View
from ringlight.data.doubts import doubts
from ringlight.data.frame import Frame
from ringlight.data.images import FILTER_NOTE, Photograph, PixelBudget, target_size
from ringlight.data.kept_pixels import Keeper
from ringlight.data.masks import with_masks
from ringlight.data.options import SceneOptions
from ringlight.data.points import scene_extent, starting_points
from ringlight.data.splits import Split, split_warnings
from ringlight.data.undistort import undistortion_note
from ringlight.errors import SceneError

VALIDATION_EVERY = 10
"""Training views of which one is held out by --validate."""


@dataclass(frozen=True)
class Capture:
    """Everything that a format module read: the split, the SfM points if there are any, and remarks for the reader."""

    format: Literal["blender", "colmap", "nerfstudio"]
    split: Split
    points: PointCloud | None = None
    notes: tuple[str, ...] = ()


def scene_from(capture: Capture, folder: Path, options: SceneOptions, keeper: Keeper | None = None) -> Scene:
    """The scene with images at the size the options ask for; of photographs none is decoded yet, of masks a few.
    ``keeper`` is asked for undistorted ones.

    Raises:
        SceneError: no image to train on, or masks that cannot be used.
        RecipeError: see :func:`ringlight.data.images.target_size`.
    """
    split = capture.split
    if not split.train:
        raise SceneError(f"{folder}: no training image; add photographs, or correct the split")
    repeated = split_warnings(split.train, split.test)
    split_notes = [split.note]
    if options.validate:
        split = _for_validation(split, folder)
        split_notes.append(split.note)
    masked = with_masks((*split.train, *split.test), folder, options)
    budget = PixelBudget(int(options.photo_memory * machine_memory()))
    views = tuple(_view(frame, options, budget, keeper) for frame in masked.frames)
    train, test = views[: len(split.train)], views[len(split.train) :]
    background = _background(views, options)
    cameras = [view.camera for view in train]
    points, box, points_note = starting_points(capture.points, cameras, options)
    lens = undistortion_note([frame.undistortion for frame in masked.frames])
    about = (*lens, _size_note(split.train, train), f"background: {background}", points_note)
    odd = doubts(points, [view.name for view in train], cameras)
    notes = (*capture.notes, *split_notes, *capture.split.warnings, *repeated, *masked.notes, *about, *odd)
    name = folder.resolve().name or "scene"  # the root of a file system has no name
    extent, source = scene_extent(cameras, box), str(folder.resolve())
    return Scene(name, train, test, points, extent, box, background, capture.format, source, notes)


def _for_validation(split: Split, folder: Path) -> Split:
    """Every 10th training view, from the first, in place of the test views."""
    held = split.train[::VALIDATION_EVERY]
    kept = [frame for index, frame in enumerate(split.train) if index % VALIDATION_EVERY]
    if not kept:
        raise SceneError(f"{folder}: 1 training image is too few for --validate; add photographs")
    note = f"validation: each training image with index % {VALIDATION_EVERY} == 0 is measured, in place of test images"
    return Split(kept, held, note)


def _view(frame: Frame, options: SceneOptions, budget: PixelBudget, keeper: Keeper | None) -> View:
    width, height = target_size(frame.camera.width, frame.camera.height, options)
    camera = frame.camera.resized(width, height)
    undistortion = frame.undistortion and frame.undistortion.at(width, height)
    photograph = Photograph(frame.path, width, height, budget, frame.mask, undistortion, frame.name, keeper)
    return View(frame.name, camera, photograph, frame.has_alpha, photograph.as_taken, photograph.mark)


def _background(views: tuple[View, ...], options: SceneOptions) -> str:
    if options.background != "auto":
        return options.background
    return "white" if any(view.has_alpha for view in views) else "photograph"


def _size_note(frames: Sequence[Frame], views: tuple[View, ...]) -> str:
    before = picture_sizes([frame.camera for frame in frames], " to ")
    after = picture_sizes([view.camera for view in views], " to ")
    deep = ", 16 bits a channel rounded to 8" if any(frame.header.is_deep for frame in frames) else ""
    if before == after:
        return f"images: {after} pixels{deep}, as they are"
    return f"images: {before} pixels{deep} downscaled to {after} by {FILTER_NOTE}"
