"""What a format finds in a folder, and how it becomes a Scene: the part that all formats share."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Literal

from ringlight.core.camera import Camera, picture_sizes
from ringlight.core.memory import machine_memory
from ringlight.core.scene import PointCloud, Scene, View
from ringlight.data.images import FILTER_NOTE, Photograph, PixelBudget, target_size
from ringlight.data.options import SceneOptions
from ringlight.data.points import scene_extent, starting_points
from ringlight.errors import SceneError

VALIDATION_EVERY = 10
"""Training views of which one is held out by --validate."""


@dataclass(frozen=True)
class Frame:
    """One image file and its camera. ``name`` is the path below the images' folder, with slashes; the camera has
    the size of the file."""

    name: str
    path: Path
    camera: Camera
    has_alpha: bool


@dataclass(frozen=True)
class Capture:
    """Everything that a format module read: the split, the SfM points if there are any, and remarks for the reader."""

    format: Literal["blender", "colmap", "nerfstudio"]
    train: Sequence[Frame]
    test: Sequence[Frame]
    points: PointCloud | None = None
    notes: tuple[str, ...] = ()


def hold_out(frames: Sequence[Frame], every: int, source: Path) -> tuple[list[Frame], list[Frame], str]:
    """Training frames, test frames (each ``every``-th by name, from the first), and the rule in words.

    Raises:
        SceneError: a split would be empty.
    """
    if len(frames) < 2:
        raise SceneError(f"{source}: {len(frames)} image is too few to hold one out for testing; add photographs")
    ordered = sorted(frames, key=lambda frame: frame.name)
    train = [frame for index, frame in enumerate(ordered) if index % every]
    note = f"split: of the images sorted by name, each with index % {every} == 0 is a test image"
    return train, ordered[::every], note


def scene_from(capture: Capture, folder: Path, options: SceneOptions) -> Scene:
    """The scene with images at the size the options ask for; nothing is decoded yet.

    Raises:
        SceneError: no image in a split.
    """
    for frames, kind in ((capture.train, "training"), (capture.test, "test")):
        if not frames:
            raise SceneError(f"{folder}: no {kind} image; add photographs, or correct the split")
    capture = _for_validation(capture, folder) if options.validate else capture
    budget = PixelBudget(int(options.photo_memory * machine_memory()))
    train = tuple(_view(frame, options, budget) for frame in capture.train)
    test = tuple(_view(frame, options, budget) for frame in capture.test)
    background = _background(train + test, options)
    cameras = [view.camera for view in train]
    points, box, points_note = starting_points(capture.points, cameras, options)
    notes = (*capture.notes, _size_note(capture.train, train), f"background: {background}", points_note)
    name = folder.resolve().name or "scene"  # the root of a file system has no name
    extent, source = scene_extent(cameras, box), str(folder.resolve())
    return Scene(name, train, test, points, extent, box, background, capture.format, source, notes)


def _for_validation(capture: Capture, folder: Path) -> Capture:
    """Every 10th training view, from the first, in place of the test views."""
    held = capture.train[::VALIDATION_EVERY]
    kept = [frame for index, frame in enumerate(capture.train) if index % VALIDATION_EVERY]
    if not kept:
        raise SceneError(f"{folder}: 1 training image is too few for --validate; add photographs")
    note = f"validation: each training image with index % {VALIDATION_EVERY} == 0 is measured, in place of test images"
    return replace(capture, train=kept, test=held, notes=(*capture.notes, note))


def _view(frame: Frame, options: SceneOptions, budget: PixelBudget) -> View:
    width, height = target_size(frame.camera.width, frame.camera.height, options)
    camera = frame.camera.resized(width, height)
    return View(frame.name, camera, Photograph(frame.path, width, height, budget), frame.has_alpha)


def _background(views: tuple[View, ...], options: SceneOptions) -> str:
    if options.background != "auto":
        return options.background
    return "white" if any(view.has_alpha for view in views) else "photograph"


def _size_note(frames: Sequence[Frame], views: tuple[View, ...]) -> str:
    before = picture_sizes([frame.camera for frame in frames], " to ")
    after = picture_sizes([view.camera for view in views], " to ")
    if before == after:
        return f"images: {after} pixels, as they are"
    return f"images: {before} pixels downscaled to {after} by {FILTER_NOTE}"
