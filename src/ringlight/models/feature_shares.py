"""How many features of a model's light say nothing any more, as its training views see them."""

from collections.abc import Sequence

from jaxtyping import Float
from torch import Tensor

from ringlight.core.camera import Camera
from ringlight.core.light_features import FeatureShares, evenly, shares_of
from ringlight.models.contract import Model

MOST_VIEWS = 4
"""Cameras looked from, evenly spread: a feature that is dead for all of them is dead, and each costs a picture."""


def feature_shares(model: Model, cameras: Sequence[Camera], background: Float[Tensor, "3"]) -> FeatureShares | None:
    """Shares of saturated and of constant features, over samples that some of ``cameras`` see; the same each time.

    None for a model without a neural light, one whose light is not switched on, and without cameras.
    """
    chosen = [cameras[index] for index in evenly(len(cameras), MOST_VIEWS).tolist()]
    found = [model.features(camera, background) for camera in chosen]
    return shares_of([features for features in found if features is not None])
