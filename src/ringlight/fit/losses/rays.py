"""The loss of lots of rays: mean squared error."""

from ringlight.core.rendering import Rendering
from ringlight.data.rays import RayBatch, RayBatches
from ringlight.fit.losses.contract import Compared
from ringlight.models.contract import Model


class RayLoss:
    """Mean squared error over pixels and channels (Mildenhall et al. 2020), by the rays' weights if they have some."""

    buffers: tuple[str, ...] = ()

    def __init__(self, batches: RayBatches):
        self._batches = batches

    @property
    def bytes_kept(self) -> int:
        """Of the photographs' pixels."""
        return self._batches.bytes_kept

    def compare(self, prediction: Rendering, batch: RayBatch, model: Model) -> Compared:
        """See :class:`ringlight.fit.losses.contract.Loss`."""
        truth = batch.colors.to(prediction.color)
        difference = prediction.color - truth
        weights = None if batch.weights is None else batch.weights.to(difference)
        weighted = difference if weights is None else difference * weights[:, None]
        value = (difference * weighted).mean()
        return Compared(value, weighted * (2 / difference.numel()), truth, weights=weights)
