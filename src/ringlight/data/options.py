"""How a folder of photographs becomes a scene; every field is also a flag of the command line. Imports no torch."""

from dataclasses import dataclass
from typing import Literal

from ringlight.errors import RecipeError


@dataclass(frozen=True)
class ReadingOptions:
    """How photographs and cameras are read: all that matters to measure a model on them.

    Raises:
        RecipeError: a field is outside its range.
    """

    format: Literal["auto", "blender", "colmap", "nerfstudio"] = "auto"
    """Layout of the folder. auto takes the first of COLMAP, Blender, nerfstudio whose files are there."""

    background: Literal["auto", "white", "black", "random"] = "auto"
    """What transparent pixels are laid over. auto is white if any image has transparency, else "photograph"."""

    downscale: int | None = None
    """Divide width and height by this. COLMAP's images_K is taken where it exists. Switches --max-width off."""

    max_width: int = 1600
    """Wider images are shrunk to this width in pixels, as in 3DGS. It does not count when --downscale is given."""

    holdout_every: int = 8
    """Every n-th image by name, from the first, is a test image, unless the scene brings a split of its own."""

    photo_memory: float = 0.25
    """Share of the machine's memory for decoded photographs. Those that do not fit are decoded at each use."""

    def __post_init__(self) -> None:
        if not 0 <= self.photo_memory <= 1:
            raise RecipeError(f"--photo-memory is {self.photo_memory:g}: give a share from 0 to 1")
        _refuse_below("--downscale", self.downscale, 1)
        _refuse_below("--max-width", self.max_width, 1)
        _refuse_below("--holdout-every", self.holdout_every, 2)


def _refuse_below(flag: str, value: int | None, least: int) -> None:
    if value is not None and value < least:
        raise RecipeError(f"{flag} is {value}: give a whole number of at least {least}")


@dataclass(frozen=True)
class SceneOptions(ReadingOptions):
    """What to make of a folder of photographs to train on.

    Raises:
        RecipeError: a field is outside its range.
    """

    initial_points: int | None = None
    """Random points to start from if the scene brings none. By default the method's own --random-points if it has some,
    else 100000, or 20000 for images up to 200 pixels a side."""

    points_seed: int = 0
    """Seed of those random points."""

    validate: bool = False
    """Hold every 10th training view out of training, and measure on these in place of the test views. Settings can then
    be chosen without a look at the test views."""

    def __post_init__(self) -> None:
        super().__post_init__()
        _refuse_below("--initial-points", self.initial_points, 1)
        _refuse_below("--points-seed", self.points_seed, 0)
