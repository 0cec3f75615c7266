"""What each run's picture is made of, from its model: one training camera of the first run, the
same for all runs that stand beside it."""

from collections.abc import Sequence
from dataclasses import dataclass

import torch

from ringlight.core.camera import Camera
from ringlight.errors import RinglightError
from ringlight.files.layer_pictures import common_depth_range, known_layers, layer_pictures, looking
from ringlight.files.video import to_8bit
from ringlight.pages.report.encoded import MOST_SIDE, picture_url
from ringlight.pages.report.groups import Group, Member
from ringlight.runs.opened import open_model

WANTED = ("color", "base", "residual", "modulation", "normal", "depth")
"""In their order on the page; a model shows those that it has."""

CAPTIONS = {
    "color": "picture",
    "base": "base colour",
    "residual": "what depends on the view, round grey",
    "modulation": "light modulation",
    "normal": "normals, world axes as red, green, blue",
    "depth": "depth, near is light",
}


@dataclass(frozen=True)
class LayersShown:
    """Data URLs by layer; ``camera``, from 0, of how many training cameras of the first run that is shown."""

    member: Member
    camera: int
    of: int
    pictures: dict[str, str]


@dataclass(frozen=True)
class _First:
    """The camera that all runs are drawn from, its place among those of its run, and the depths that run shows."""

    camera: Camera
    index: int
    of: int
    near_far: tuple[float, float]


def layers_shown(group: Group) -> tuple[list[LayersShown], list[str]]:
    """For each run whose model can be opened, and a sentence for each that cannot."""
    shown: list[LayersShown] = []
    troubles: list[str] = []
    first: _First | None = None
    for member in group.members:
        try:
            opened = open_model(member.run.folder)
            cameras, model = opened.stored.cameras, opened.stored.model
            if not cameras:
                troubles.append(
                    f"{member.run.folder}: its model holds no training cameras, so its layers are not shown."
                )
                continue
            index = first.index if first else len(cameras) // 2
            camera = first.camera if first else _small(cameras[index])
            layers, _ = known_layers(model, camera, WANTED)
            background = torch.zeros(3) if opened.stored.header.scene.background == "black" else torch.ones(3)
            look = looking(model, background, layers)
            first = first or _First(camera, index, len(cameras), common_depth_range(look, [camera]))
            # Where the run never trained from there, its world may be another one, and so are its distances.
            near_far = first.near_far if _holds(cameras, camera) else common_depth_range(look, [camera])
            pictures = layer_pictures(look(camera), background, layers, near_far)
            urls = {layer: picture_url(to_8bit(pictures[layer])) for layer in layers}
            shown.append(LayersShown(member, first.index, first.of, urls))
        except RinglightError as error:
            troubles.append(f"{error}.")
    return shown, troubles


def _small(camera: Camera) -> Camera:
    share = min(MOST_SIDE / max(camera.width, camera.height), 1.0)
    return camera.resized(max(round(camera.width * share), 1), max(round(camera.height * share), 1))


def _holds(cameras: Sequence[Camera], camera: Camera) -> bool:
    """Whether one of them stands and looks as ``camera``."""
    return any(torch.equal(one.world_to_camera, camera.world_to_camera) for one in cameras)


def layer_names(shown: Sequence[LayersShown]) -> list[str]:
    """Those that any run has, in order."""
    return [layer for layer in WANTED if any(layer in one.pictures for one in shown)]
