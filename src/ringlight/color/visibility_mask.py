"""The learnable visibility mask (RingLight-GS, eq. 10; after Compact 3DGS): a step forward, a sigmoid backward."""

from jaxtyping import Float
from torch import Tensor


def straight_through_mask(logits: Float[Tensor, "N"], threshold: float) -> Float[Tensor, "N 1"]:
    """One where sigmoid(logit) > threshold and zero elsewhere, exactly; its gradient is the sigmoid's."""
    soft = logits.sigmoid()
    hard = (soft.detach() > threshold).to(soft)
    # soft - soft is exactly zero, so the sum keeps the value of the step and the gradient of the sigmoid.
    return (hard + (soft - soft.detach()))[:, None]
