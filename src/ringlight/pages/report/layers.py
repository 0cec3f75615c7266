"""What each run's picture is made of, from its model: one training camera, the same for all runs of a scene."""

from collections.abc import Sequence
from dataclasses import dataclass

import torch

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
    """Data URLs by layer; ``camera`` of how many training cameras."""

    member: Member
    camera: int
    of: int
    pictures: dict[str, str]


def layers_shown(group: Group) -> tuple[list[LayersShown], list[str]]:
    """For each run whose model can be opened, and a sentence for each that cannot."""
    shown: list[LayersShown] = []
    troubles: list[str] = []
    near_far: tuple[float, float] | None = None
    for member in group.members:
        try:
            opened = open_model(member.run.folder)
            cameras, model = opened.stored.cameras, opened.stored.model
            if not cameras:
                troubles.append(
                    f"{member.run.folder}: its model holds no training cameras, so its layers are not shown."
                )
                continue
            index = len(cameras) // 2
            camera = cameras[index]
            share = min(MOST_SIDE / max(camera.width, camera.height), 1.0)
            camera = camera.resized(max(round(camera.width * share), 1), max(round(camera.height * share), 1))
            layers, _ = known_layers(model, camera, WANTED)
            background = torch.zeros(3) if opened.stored.header.scene.background == "black" else torch.ones(3)
            look = looking(model, background, layers)
            near_far = near_far or common_depth_range(look, [camera])
            pictures = layer_pictures(look(camera), background, layers, near_far)
            urls = {layer: picture_url(to_8bit(pictures[layer])) for layer in layers}
            shown.append(LayersShown(member, index, len(cameras), urls))
        except RinglightError as error:
            troubles.append(f"{error}.")
    return shown, troubles


def layer_names(shown: Sequence[LayersShown]) -> list[str]:
    """Those that any run has, in order."""
    return [layer for layer in WANTED if any(layer in one.pictures for one in shown)]
