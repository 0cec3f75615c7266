"""Photographs bent by a lens and undistorted again show what a pinhole would have taken."""

import json

import numpy as np
import pytest
from PIL import Image

from distorted_copies import COEFFICIENTS, SHRUNK, lenses_for, places_in, resampler
from ringlight.data.colmap_binary import read_cameras
from ringlight.data.colmap_model import intrinsics_of
from ringlight.data.intrinsics import Intrinsics
from ringlight.data.undistort import undistortion_of
from shared_data import shared

BORDER = 16
"""Pixels that are not compared: there the copies were mirrored at the photograph's border."""

AGREED = 40.0
"""Decibels. All lenses reach 40.4 to 47; half a pixel of shift leaves 29 to 31."""


def photograph_of(scene: str) -> tuple[Intrinsics, Image.Image]:
    folder = shared(f"data/{scene}")
    if scene == "family_24":
        camera = next(iter(read_cameras(folder / "sparse" / "0" / "cameras.bin").values()))
        taken = intrinsics_of(camera, scene, "").resized(camera.width // SHRUNK, camera.height // SHRUNK)
        path = sorted((folder / "images").iterdir())[5]
        with Image.open(path) as photograph:
            small = photograph.convert("RGB").resize((taken.width, taken.height), Image.Resampling.LANCZOS)
        return taken, small
    angle = json.loads((folder / "transforms_train.json").read_text())["camera_angle_x"]
    with Image.open(folder / "train" / "r_5.png") as photograph:
        width, height = photograph.size
        focal = 0.5 * width / np.tan(0.5 * angle)
        return Intrinsics((focal, focal), (width / 2, height / 2), width, height), photograph.convert("RGBA")


def on_black(pixels: np.ndarray) -> np.ndarray:
    """Without the border; [H W 3], 0 to 255."""
    inner = pixels[BORDER:-BORDER, BORDER:-BORDER].astype(float)
    return inner[..., :3] * inner[..., 3:] / 255 if inner.shape[2] == 4 else inner


@pytest.mark.parametrize("model", COEFFICIENTS)
@pytest.mark.parametrize("scene", ["family_24", "chair_400"])
def test_what_was_bent_is_straight_again(scene: str, model: str):
    taken, photograph = photograph_of(scene)
    lenses = lenses_for(taken, model, inside=scene == "family_24")
    undistortion = undistortion_of(lenses.bent, model)
    assert undistortion is not None
    bent, straight = (resampler(places_in(one, taken))(photograph) for one in (lenses.bent, lenses.straight))
    error = on_black(undistortion(np.array(bent))) - on_black(np.array(straight))
    assert 10 * np.log10(255**2 / np.square(error).mean()) > AGREED
