"""The angle between a model's normals and the true ones, and its measures over pixels of one view or of many."""

from dataclasses import dataclass, field

import numpy as np
from jaxtyping import Float

COVERED = 0.5
"""Alpha from which on a pixel has a normal. Below, more of it is background than surface, and what is blended there are
remnants of an edge or of floaters, whose direction says nothing of the surface."""

NEAR = 11.25
"""Degrees, the narrowest of the three bounds that are customary for estimated normals (Fouhey, Gupta, Hebert 2013)."""

STEP = 0.01
"""Degrees: how finely angles are counted for a median, so that it takes no memory that grows with the views."""

BINS = round(180 / STEP)


@dataclass(frozen=True, kw_only=True)
class NormalScore:
    """Degrees and shares of 1; None where no pixel could be compared. ``pixels`` have a true normal, ``compared`` is
    the share of them where the model has one too."""

    mean: float | None
    median: float | None
    within_11_25: float | None
    compared: float
    pixels: int


@dataclass(frozen=True)
class ComparedNormals:
    """One view: the model's normals and alpha, the true normals, and ``angles`` between them in degrees, NaN where not
    both exist."""

    normals: Float[np.ndarray, "H W 3"]
    alpha: Float[np.ndarray, "H W 1"]
    truth: Float[np.ndarray, "H W 3"]
    angles: Float[np.ndarray, "H W"]


def compare_normals(
    normals: Float[np.ndarray, "H W 3"], alpha: Float[np.ndarray, "H W 1"], truth: Float[np.ndarray, "H W 3"]
) -> ComparedNormals:
    """Both exist where the true normal is not zero, and the model covers the pixel with a normal of its own."""
    own = np.isfinite(normals).all(-1) & normals.any(-1)
    both = truth.any(-1) & own & (alpha[..., 0] >= COVERED)
    angles = np.full(both.shape, np.nan)
    angles[both] = angles_between(normals[both].astype(np.float64), truth[both])
    return ComparedNormals(normals, alpha, truth, angles)


def angles_between(
    one: Float[np.ndarray, "*shape 3"], other: Float[np.ndarray, "*shape 3"]
) -> Float[np.ndarray, "*shape"]:
    """Degrees, 0 to 180, of vectors of any length but zero. By the tangent: the cosine knows small angles badly."""
    sine = np.linalg.norm(np.cross(one, other), axis=-1)
    return np.degrees(np.arctan2(sine, (one * other).sum(-1)))


@dataclass
class AngleSums:
    """Counts angles; what it takes does not depend on how many."""

    pixels: int = 0
    total: float = 0.0
    near: int = 0
    counts: np.ndarray = field(default_factory=lambda: np.zeros(BINS, np.int64))

    def add(self, view: ComparedNormals) -> None:
        """All pixels of a view."""
        angles = view.angles[~np.isnan(view.angles)]
        self.pixels += int(view.truth.any(-1).sum())
        self.total += float(angles.sum())
        self.near += int((angles < NEAR).sum())
        self.counts += np.bincount(np.minimum((angles / STEP).astype(np.int64), BINS - 1), minlength=BINS)

    def score(self) -> NormalScore:
        """Means over all that was added, each pixel alike. The median is within half a :data:`STEP`."""
        count = int(self.counts.sum())
        return NormalScore(
            mean=self.total / count if count else None,
            median=self._median(count) if count else None,
            within_11_25=self.near / count if count else None,
            compared=count / self.pixels if self.pixels else 0.0,
            pixels=self.pixels,
        )

    def _median(self, count: int) -> float:
        """The mean of the two middle angles, each taken as the middle of its step."""
        ranks = np.cumsum(self.counts)
        middle = [int(np.searchsorted(ranks, rank, side="right")) for rank in ((count - 1) // 2, count // 2)]
        return (sum(middle) / 2 + 0.5) * STEP


def score_of(view: ComparedNormals) -> NormalScore:
    """Of this view alone."""
    sums = AngleSums()
    sums.add(view)
    return sums.score()
