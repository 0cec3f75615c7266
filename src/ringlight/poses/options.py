"""How cameras are found; every field is also a flag of the command line. Imports nothing heavy."""

from dataclasses import dataclass
from typing import Literal

from ringlight.errors import RecipeError

Lens = Literal[
    "auto", "simple-pinhole", "pinhole", "simple-radial", "radial", "opencv", "opencv-fisheye", "full-opencv"
]


@dataclass(frozen=True)
class PosesOptions:
    """What decides the cameras; a run that goes on must ask for the same.

    Raises:
        RecipeError: a field is outside its range.
    """

    lens: Lens = "auto"
    """COLMAP's camera model. auto is simple-radial, and simple-pinhole for cut-out images without a camera's EXIF."""

    matching: Literal["auto", "exhaustive", "neighbours"] = "auto"
    """Which pairs are compared. exhaustive is all; neighbours are those next by name and those that look alike. auto is
    exhaustive for up to 150 photographs, and neighbours for more and for films."""

    mapper: Literal["auto", "incremental", "global"] = "auto"
    """incremental adds photograph by photograph, global solves all at once (GLOMAP). auto is incremental up to 400
    photographs, else global; where one leaves photographs out the other is tried, and the better taken."""

    features: int = 4096
    """Most SIFT features of a photograph; the largest are kept."""

    feature_size: int = 1600
    """Longest side, in pixels, at which features are sought."""

    frames: int = 150
    """Most photographs that are taken of a film."""

    seed: int = 0
    """Of COLMAP's random samples."""

    def __post_init__(self) -> None:
        for name, least in (("features", 100), ("feature_size", 100), ("frames", 3), ("seed", 0)):
            value = getattr(self, name)
            if value < least:
                raise RecipeError(f"--{name.replace('_', '-')} is {value}: give a whole number of at least {least}")
