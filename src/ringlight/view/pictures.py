"""The picture of a window: which sources it shows, and where."""

import numpy as np
import torch
from jaxtyping import Float, UInt8
from torch import Tensor

from ringlight.core.camera import Camera
from ringlight.files.camera_paths import position_of
from ringlight.view.model_picture import model_picture
from ringlight.view.panes import Pane, behind_curtain, joined, side_by_side
from ringlight.view.photograph import NOTHING, placed
from ringlight.view.standpoint import is_same_pose
from ringlight.view.subject import PHOTOGRAPH, Subject
from ringlight.view.wishes import ALL, ALONE, CURTAIN, Look


class Pictures:
    """Of a subject; keeps the photograph that was decoded last."""

    def __init__(self, subject: Subject):
        self.subject = subject
        self._photograph: tuple[str, Tensor] | None = None

    def picture(self, camera: Camera, look: Look) -> UInt8[np.ndarray, "H W 3"] | None:
        """What a window with this camera shows; None where that is nothing. Raises RinglightError where a photograph
        cannot be decoded or a camera not be drawn."""
        if look.arrangement == CURTAIN:
            panes = behind_curtain(camera, look.left, look.right, look.curtain)
        else:
            panes = side_by_side(camera, self.sources(look))
        pictures = [self._pane(pane, look) for pane in panes]
        if all(picture is None for picture in pictures):
            return None
        whole = joined([_or_gray(picture, pane.camera) for picture, pane in zip(pictures, panes, strict=True)])
        array: np.ndarray = (whole.clamp(0, 1) * 255 + 0.5).to(torch.uint8).contiguous().numpy()
        return array

    def sources(self, look: Look) -> list[str]:
        """What is shown, from the left."""
        if look.arrangement == ALL and self.subject.sources:
            return list(self.subject.sources)
        return [look.left] if look.arrangement == ALONE else [look.left, look.right]

    def kind(self, look: Look) -> tuple[object, ...]:
        """Pictures of one kind cost alike."""
        return (look.layer, look.light == 1.0, *self.sources(look))

    def photographed(self, camera: Camera) -> str | None:
        """The photograph that was taken where ``camera`` stands and looks."""
        near = self.subject.views_near(position_of(camera)[None])
        same = (
            name
            for name in self.subject.photographs
            if name in near and is_same_pose(self.subject.views[name], camera, self.subject.extent)
        )
        return next(same, None)

    def _pane(self, pane: Pane, look: Look) -> Float[Tensor, "H W 3"] | None:
        """None where there is nothing to see: no photograph was taken from here."""
        if pane.source != PHOTOGRAPH:
            source = self.subject.sources[pane.source]
            return model_picture(source.model, pane.camera, source.background, look.layer, look.light)
        name = self.photographed(pane.camera)
        if name is None:
            return None
        if self._photograph is None or self._photograph[0] != name:
            self._photograph = (name, self.subject.photographs[name]())
        return placed(self._photograph[1], self.subject.views[name], pane.camera)


def _or_gray(picture: Tensor | None, camera: Camera) -> Float[Tensor, "H W 3"]:
    return torch.full((camera.height, camera.width, 3), NOTHING) if picture is None else picture
