"""A page that remembers what it was told, and small subjects for it."""

from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np
import torch

from ringlight.core.camera import Camera
from ringlight.core.scene import Scene
from ringlight.fit.train import Training, train
from ringlight.rasterize.choose import rasterizer_for
from ringlight.view.curves import Curves
from ringlight.view.standpoint import Standpoint, standpoint_at
from ringlight.view.subject import Subject, subject
from small_recipes import small

LIT_AFTER = {"3dgs": 10, "ringlight-basis": 10, "ringlight-ring": 30, "ringlight-mirror": 30}
"""Steps after which a method shows more than base colours, of a small run of 40."""


class RecordedPage:
    """What each browser has now, and all that was said."""

    def __init__(self) -> None:
        self.pictures: list[tuple[int, np.ndarray | None, bool]] = []
        self.places: list[tuple[int, Standpoint]] = []
        self.sentences: list[tuple[int, str, bool]] = []
        self.states: list[tuple[str, bool]] = []
        self.drawn: list[Mapping[str, Curves]] = []
        self.thumbnails: dict[str, np.ndarray] = {}
        self.key_cameras: list[Camera] = []
        self.hidden: frozenset[str] = frozenset()
        self.is_closed = False

    def show(self, browser: int, picture: np.ndarray | None, is_final: bool) -> None:
        self.pictures.append((browser, picture, is_final))

    def place(self, browser: int, standpoint: Standpoint, looked_at: np.ndarray) -> None:
        self.places.append((browser, standpoint))

    def tell(self, browser: int, sentence: str, is_trouble: bool = False) -> None:
        self.sentences.append((browser, sentence, is_trouble))

    def status(self, text: str, is_paused: bool) -> None:
        self.states.append((text, is_paused))

    def curves(self, curves: Mapping[str, Curves]) -> None:
        self.drawn.append(curves)

    def thumbnail(self, view: str, picture: np.ndarray) -> None:
        self.thumbnails[view] = picture

    def hide_cameras(self, views: frozenset[str]) -> None:
        self.hidden = views

    def keys(self, cameras: Sequence[Camera], flight: np.ndarray) -> None:
        self.key_cameras = list(cameras)

    def close(self) -> None:
        self.is_closed = True


class Clock:
    """Seconds that pass when a test says so, and ``each`` at every look."""

    def __init__(self, each: float = 0.0):
        self.seconds, self.each = 100.0, each

    def __call__(self) -> float:
        self.seconds += self.each
        return self.seconds


def trained(method: str, scene: Scene, steps: int | None = None) -> Training:
    training = small(method, steps=40).build(scene, rasterizer_for("cpu"), seed=0)
    progress = train(training)
    for _ in range(LIT_AFTER[method] if steps is None else steps):
        next(progress)
    with torch.no_grad():  # harmonics learn slowly: as if they had
        for name in {"sh_rest", "basis_weights"} & set(training.model.columns):
            column = training.model.columns[name]
            column.add_(0.3 * torch.randn(column.shape, generator=torch.Generator().manual_seed(1)))
    return training


def subject_of(scene: Scene, home: Path, **models: Training) -> Subject:
    named = {name: (training.model, scene.background_color) for name, training in models.items()}
    return subject("a title", named, [], scene, home, home)


def standing(camera: Camera, width: int = 320, height: int = 240) -> Standpoint:
    return standpoint_at(camera, width, height)
