"""How a folder of photographs becomes a scene; every field is also a flag of the command line. Imports no torch."""

from dataclasses import dataclass
from typing import Literal

from ringlight.core.later import later
from ringlight.errors import RecipeError

FOUND = "auto"
"""A folder that is looked for in the scene's own."""

UNUSED = "none"
"""A folder that is not looked at."""


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

    photos: str = later(FOUND)
    """Folder of a COLMAP model's photographs. auto is images or another usual name beside sparse, else the only folder
    that holds them all."""

    masks: str = later(UNUSED, now=FOUND)
    """Folder of masks, in the scene's folder or anywhere, one for each photograph NAME, called NAME.png or NAME: white
    is kept, black becomes background. auto takes those that the scene names, else its folder masks; none takes none."""

    invert_masks: bool = later(False)
    """Black is kept instead of white."""

    holdout_every: int = 8
    """Every n-th image by name, from the first, is a test image, unless the scene brings a split of its own. 0: all
    images are for training, whatever the scene says."""

    holdout: str | None = later(None)
    """Test images in place of any split: their names with commas between, or a file ending in .txt with one a line."""

    photo_memory: float = 0.25
    """Share of the machine's memory for decoded photographs. Those that do not fit are decoded at each use."""

    def __post_init__(self) -> None:
        if not 0 <= self.photo_memory <= 1:
            raise RecipeError(f"--photo-memory is {self.photo_memory:g}: give a share from 0 to 1")
        _refuse_below("--downscale", self.downscale, 1)
        _refuse_below("--max-width", self.max_width, 1)
        if self.holdout_every == 1:
            raise RecipeError(
                "--holdout-every is 1: no image would be left for training; give 2 or more, or 0 for none"
            )
        _refuse_below("--holdout-every", self.holdout_every, 0)
        if self.invert_masks and self.masks == UNUSED:
            raise RecipeError("--invert-masks and --masks none do not go together; leave one of them out")


MOST_POINTS = 100_000_000
"""Random points: a scene of so many Gaussians takes more memory than machines of today have."""


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
        if (self.initial_points or 0) > MOST_POINTS:
            raise RecipeError(f"--initial-points is {self.initial_points}: give at most {MOST_POINTS:,}")
        _refuse_below("--points-seed", self.points_seed, 0)
