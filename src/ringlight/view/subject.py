"""What is looked at: models of one scene, its cameras with their photographs, its points."""

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np
import torch
from jaxtyping import Float
from torch import Tensor

from ringlight.core.camera import Camera
from ringlight.core.scene import PointCloud, Scene, View, camera_extent
from ringlight.files.camera_paths import Array, position_of
from ringlight.files.orbit import Orbit, orbit_of
from ringlight.models.contract import Model
from ringlight.view.model_picture import layers_of

PHOTOGRAPH = "photograph"
"""Source of what was photographed, beside the models' names."""

FIRST_SIDE, FIRST_FOCAL = 400, 500.0
"""Pixels of the camera that looks at a model without cameras."""

NEAR_SHARE = 0.1
"""Of the extent: twice the length of a camera as it is drawn."""

SMALLEST_SPREAD = 0.1
"""Of the distance between cameras and what they see: cameras may all stand in one place."""

MOST_CAMERAS = 300
"""Drawn ones: each is an object of its own in the browser."""

OUTER = 0.02
"""Share of the Gaussians on each side that is no part of what such a camera shall see."""


@dataclass(frozen=True)
class Source:
    """A model, what lies behind its Gaussians, and the layers that it has."""

    model: Model
    background: Float[Tensor, "3"]
    layers: tuple[str, ...]


@dataclass(frozen=True)
class Subject:
    """``sources`` by name; cameras by the names of their ``views``, of which ``photographs`` has those that can be
    shown.

    ``center`` is what the cameras look at and ``up`` its up axis, ``extent`` their spread, world units, and no less
    than a share of how far what they see is; ``start`` is where a browser begins. Files that are written go to the
    folder ``home``; ``film_of`` is the model that a written path is for.
    """

    title: str
    sources: Mapping[str, Source]
    views: Mapping[str, Camera]
    photographs: Mapping[str, Callable[[], Float[Tensor, "3 h w"]]]
    points: PointCloud | None
    center: Array
    up: Array
    extent: float
    start: Camera
    home: Path
    film_of: Path | None = None
    sources_shown: tuple[str, ...] = field(init=False)
    """Names of the models, and PHOTOGRAPH where there are any."""
    _places: Array = field(init=False, repr=False)
    """Of the views' cameras [V 3]."""

    def __post_init__(self) -> None:
        shown = (*self.sources, *([PHOTOGRAPH] if self.photographs else ()))
        object.__setattr__(self, "sources_shown", shown)
        places = [position_of(camera) for camera in self.views.values()]
        object.__setattr__(self, "_places", np.stack(places) if places else np.zeros((0, 3)))

    def with_model(self, name: str, model: Model, background: Float[Tensor, "3"]) -> "Subject":
        """The same with another model in the place of the one of that ``name``."""
        source = Source(model, background, layers_of(model, self.start))
        return replace(self, sources={**self.sources, name: source})

    def views_near(self, places: Float[np.ndarray, "P 3"]) -> frozenset[str]:
        """Cameras within NEAR_SHARE of the extent of any of these places, world units."""
        apart = np.linalg.norm(self._places[:, None] - places[None], axis=-1)
        near = (apart < NEAR_SHARE * self.extent).any(1)
        return frozenset(name for name, is_near in zip(self.views, near, strict=True) if is_near)

    @property
    def drawn_views(self) -> tuple[str, ...]:
        """Views whose cameras are drawn, evenly chosen."""
        return tuple(self.views)[:: max(math.ceil(len(self.views) / MOST_CAMERAS), 1)]

    @property
    def layers(self) -> tuple[str, ...]:
        """Those that any of the models has."""
        return tuple(dict.fromkeys(name for source in self.sources.values() for name in source.layers))


def subject(
    title: str,
    models: Mapping[str, tuple[Model, Float[Tensor, "3"]]],
    cameras: Sequence[Camera],
    scene: Scene | None,
    home: Path,
    film_of: Path | None = None,
) -> Subject:
    """Of models with their backgrounds, the training ``cameras`` that they bring, and the scene if its photographs are
    at hand; at least one of the two last, or a model of Gaussians."""
    views = _views(cameras, scene)
    everything = _means([model for model, _ in models.values()])
    if scene is not None and not len(everything):
        everything = scene.points.positions
    if views:
        orbit = orbit_of(list(views.values()))
        start, extent = next(iter(views.values())), _extent(list(views.values()), everything)
    else:
        orbit, extent = _round(everything)
        start = orbit.cameras(1)[0]
    sources = {name: Source(model, behind, layers_of(model, start)) for name, (model, behind) in models.items()}
    return Subject(
        title,
        sources,
        views,
        _photographs(scene),
        None if models or scene is None else scene.points,
        orbit.center,
        orbit.up,
        extent,
        start,
        home,
        film_of,
    )


def _views(cameras: Sequence[Camera], scene: Scene | None) -> dict[str, Camera]:
    if scene is not None:
        return {view.name: view.camera for view in (*scene.test, *scene.train)}
    return {f"camera {index}": camera for index, camera in enumerate(cameras)}


def _photographs(scene: Scene | None) -> dict[str, Callable[[], Float[Tensor, "3 h w"]]]:
    if scene is None:
        return {}
    behind = scene.background_color

    def loader(view: View) -> Callable[[], Float[Tensor, "3 h w"]]:
        return lambda: view.image(behind)

    return {view.name: loader(view) for view in (*scene.test, *scene.train)}


def _means(models: Sequence[Model]) -> Float[Tensor, "N 3"]:
    """Of all their Gaussians."""
    tables = [splats.gaussians.means.detach().cpu() for model in models if (splats := model.splats()) is not None]
    return torch.cat(tables) if tables else torch.zeros(0, 3)


def _extent(cameras: list[Camera], seen: Float[Tensor, "N 3"]) -> float:
    """Spread of the cameras, or a share of how far the middle of what they see is from the first, world units."""
    spread = camera_extent(cameras)
    if not len(seen):
        return spread
    apart = np.median(np.linalg.norm(seen.double().numpy() - position_of(cameras[0]), axis=1))
    return max(spread, SMALLEST_SPREAD * float(apart))


def _round(means: Float[Tensor, "N 3"]) -> tuple[Orbit, float]:
    """An orbit round these places, with z for up, and their spread."""
    means = means if len(means) else torch.tensor([[-1.0, -1.0, -1.0], [1.0, 1.0, 1.0]])
    low, high = np.quantile(means.double().numpy(), (OUTER, 1 - OUTER), axis=0)
    extent = max(float(np.linalg.norm(high - low)), 1e-3)
    like = Camera(torch.eye(4), (FIRST_FOCAL,) * 2, (FIRST_SIDE / 2,) * 2, FIRST_SIDE, FIRST_SIDE)
    towards = np.array([0.8, -0.6, 0.0])
    up = np.array([0.0, 0.0, 1.0])
    return Orbit((low + high) / 2, up, towards, 1.2 * extent, 0.4 * extent, 360.0, like), extent
