"""Floating-point operations of the blending kernels, counted from their formulas.

A multiply-add counts two, a division, a minimum or a reciprocal one, comparisons, selections and the integer part of
2^x nothing. With d = pixel - centre, u = A dx + B dy, v = C dy, log2(alpha) = L - u^2 - v^2:

* evaluating a pair: 2 for d, 3 for u, 1 for v, 4 for log2(alpha), 12 for 2^x, 1 for the clamp: 23, in each pass;
* blending a pair forward: T - alpha T and the weight alpha T, then a multiply-add a channel: 3 + 2 C;
* blending a pair backward: the same T and weight 3; v . channels 2 C - 1; own part, rest and its share of g 7; g u and
  g v 2; six moments 9; a multiply-add a channel: 20 + 4 C.

Lanes of a block where the Gaussian is too faint, or the pixel finished, are evaluated and not blended: the kernels
compute them all the same, so that the real load of the units is higher than these numbers say.
"""

from dataclasses import dataclass

EVALUATION = 23
BLEND_FORWARD, BLEND_FORWARD_CHANNEL = 3, 2
BLEND_BACKWARD, BLEND_BACKWARD_CHANNEL = 20, 4


@dataclass(frozen=True)
class Pairs:
    """Pairs of Gaussian and pixel of one view: those computed, and those that changed the image."""

    evaluated: int
    blended: int

    def flops(self, channels: int) -> int:
        """Operations of blending, forward and backward; projection and sorting are not counted."""
        forward = BLEND_FORWARD + BLEND_FORWARD_CHANNEL * channels
        backward = BLEND_BACKWARD + BLEND_BACKWARD_CHANNEL * channels
        return 2 * EVALUATION * self.evaluated + (forward + backward) * self.blended
