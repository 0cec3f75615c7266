"""Which Gaussians lie hidden: those of which the photographs see next to nothing."""

from collections.abc import Sequence

from jaxtyping import Float
from torch import Tensor

from ringlight.core.camera import Camera
from ringlight.fit.strategies.blending_weights import coverage
from ringlight.models.splats import SplatModel

LEAST_FOOTPRINT = 1e-12
"""Square pixels; a row that touches no picture has none, and nothing of it is seen."""


def seen_shares(model: SplatModel, cameras: Sequence[Camera]) -> Float[Tensor, "N"]:
    """How much of what each row would cover alone shows in the pictures of all ``cameras``: 0 for nothing, and about as
    much for all rows that nothing hides, far or near.

    What lies under a surface adds a little through it or around its edge, and costs nothing that a training view would
    show. A camera that comes from where none was sees all of it.
    """
    weights, footprints = coverage(model, cameras)
    return weights / footprints.clamp_min(LEAST_FOOTPRINT)
