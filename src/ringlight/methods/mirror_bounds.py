"""How many Gaussians a mirror takes where a hull cuts its subject out."""

import math

PIXELS_PER_GAUSSIAN = 7
"""What a mirror shows is in the shader, so that a Gaussian serves several pixels of a subject that is cut out."""

WITHOUT_HULL = 0.75
"""Gaussians for each pixel where no hull cuts the subject out, for what surrounds it needs some of its own. One for
each is worth 0.25 dB after 7,000 steps, and takes 0.44 instead of a third of the bytes of `3dgs`
(docs/experiments/without-masks.md)."""

ALWAYS_ENOUGH, MANY, FOR_EACH_VIEW = 10_000, 20_000, 200
"""Gaussians for small photographs, where those have as many pixels: shapes need them however few pixels show it. Many
photographs show finer shapes than one: with 100 views of 200 x 200 pixels 20,000 are worth 0.3 to 0.4 dB."""


def most_gaussians(pixels: int, views: int) -> int:
    """Bound on the number of Gaussians for so many photographs, of that many pixels each, of a subject that a hull cuts
    out."""
    at_least = min(max(FOR_EACH_VIEW * views, ALWAYS_ENOUGH), MANY)
    return min(pixels, max(at_least, math.ceil(pixels / PIXELS_PER_GAUSSIAN)))


def most_without_hull(pixels: int) -> int:
    """The same where no hull cuts the subject out."""
    return min(pixels, max(ALWAYS_ENOUGH, math.ceil(WITHOUT_HULL * pixels)))
