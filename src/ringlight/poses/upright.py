"""Which way is up: from how photographers hold cameras, since structure from motion cannot know it."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from ringlight.core.words import counted

ROTATION_BY_EXIF = {1: 0, 2: 0, 3: 2, 4: 2, 5: 1, 6: 1, 7: 3, 8: 3}
"""Quarter turns, clockwise, that show a stored picture as it was held (TIFF 6.0, tag Orientation); mirrored ones as
their unmirrored neighbours, since no camera mirrors."""

LEVEL = 0.08
"""Mean square of the right axes along up, below which cameras were held level: an angle of 16 degrees."""

SPREAD = 0.05
"""Least mean square of the right axes along their second direction, below which they all point one way and do not tell
which of the directions across is up."""

FLAT = 0.15
"""Of a path of cameras: largest deviation from its plane over that along its second direction."""

UPRIGHT = 1e-14
"""Sine of an angle to the z axis that is nothing but rounding."""


@dataclass(frozen=True)
class Up:
    """Unit vector of the world that points up, and why it is believed."""

    direction: Float[np.ndarray, "3"]
    reason: str


def find_up(
    camera_from_world: Float[np.ndarray, "V 3 3"], centers: Float[np.ndarray, "V 3"], orientations: list[int]
) -> Up:
    """Up for cameras with axes right, down, forward; ``orientations`` are the EXIF tags of their photographs (1 to 8).

    Cameras are held level, so that their right axes lie in the horizontal plane, whatever they look at. Where these
    axes all point one way the mean of the cameras' up axes decides, and where cameras were rolled, the plane in which
    they lie.
    """
    right, up = held_axes(camera_from_world, orientations)
    mean_up = _unit(up.mean(0))
    turned = sum(ROTATION_BY_EXIF.get(tag, 0) != 0 for tag in orientations)
    by_exif = f"; {counted(turned, 'photograph')} turned by the EXIF orientation" if turned else ""
    shares, axes = np.linalg.eigh(right.T @ right / len(right))
    if shares[0] < LEVEL and shares[1] > SPREAD:
        return Up(_towards(axes[:, 0], mean_up), f"the cameras were held level{by_exif}")
    if shares[0] < LEVEL:
        return Up(mean_up, f"the mean of the cameras' up axes, which are nearly the same{by_exif}")
    spreads, planes = np.linalg.eigh(np.cov(centers.T, bias=True).reshape(3, 3))
    if len(centers) > 3 and spreads[0] < FLAT**2 * spreads[1]:
        return Up(_towards(planes[:, 0], mean_up), "the cameras were not held level, and lie in a plane")
    return Up(mean_up, "a guess: the cameras were not held level, and do not lie in a plane")


def held_axes(
    camera_from_world: Float[np.ndarray, "V 3 3"], orientations: list[int]
) -> tuple[Float[np.ndarray, "V 3"], Float[np.ndarray, "V 3"]]:
    """Right and up, in the world, of each photograph as it was held, not as it is stored."""
    right, down = camera_from_world[:, 0], camera_from_world[:, 1]
    sides = np.stack([right, down, -right, -down])  # of the stored picture, clockwise
    turns = np.array([ROTATION_BY_EXIF.get(tag, 0) for tag in orientations])
    rows = np.arange(len(turns))
    # A picture that is shown after a clockwise quarter turn has its right side where its stored top was.
    return sides[(0 - turns) % 4, rows], sides[(3 - turns) % 4, rows]


def rotation_to_z(up: Float[np.ndarray, "3"]) -> Float[np.ndarray, "3 3"]:
    """The smallest rotation that takes the unit vector ``up`` to +z, by Rodrigues' formula: as exact next to -z, where
    1 + cos cancels, as anywhere."""
    sine, cosine = float(np.hypot(up[0], up[1])), float(up[2])
    if sine < UPRIGHT:
        return np.eye(3) if cosine > 0 else np.diag([1.0, -1.0, -1.0])
    x, y = up[1] / sine, -up[0] / sine  # the axis, up × z
    across = np.array([[0, 0, y], [0, 0, -x], [-y, x, 0]])
    result: Float[np.ndarray, "3 3"] = np.eye(3) + sine * across + (1 - cosine) * across @ across
    return result


def _unit(vector: Float[np.ndarray, "3"]) -> Float[np.ndarray, "3"]:
    length = np.linalg.norm(vector)
    return vector / length if length > 1e-9 else np.array([0.0, -1.0, 0.0])


def _towards(axis: Float[np.ndarray, "3"], up: Float[np.ndarray, "3"]) -> Float[np.ndarray, "3"]:
    return axis if axis @ up >= 0 else -axis
