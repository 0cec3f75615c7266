"""COLMAP cameras for tests of lenses: real ones, and random ones that fold nothing over."""

from typing import Any

import hypothesis.strategies as st
import numpy as np
import pytest
from PIL import PngImagePlugin  # noqa: F401  # before pycolmap, whose own zlib would be Pillow's: it crashes then

from ringlight.data.colmap_model import MODELS_BY_NAME, ColmapCamera, intrinsics_of
from ringlight.data.intrinsics import Intrinsics

WIDTH, HEIGHT = 320, 240

REAL = {
    "SIMPLE_RADIAL": (300.0, 158.0, 123.0, -0.08),
    "RADIAL": (280.0, 163.0, 118.0, 0.09, 0.03),
    "OPENCV": (290.0, 295.0, 162.0, 117.0, -0.21, 0.06, 0.002, -0.003),
    "FULL_OPENCV": (290.0, 288.0, 159.0, 121.0, 0.31, 0.12, -0.001, 0.002, 0.02, 0.52, 0.08, 0.01),
    "OPENCV_FISHEYE": (180.0, 182.0, 158.0, 121.0, 0.03, -0.01, 0.004, -0.001),
    "SIMPLE_RADIAL_FISHEYE": (190.0, 161.0, 119.0, 0.04),
    "RADIAL_FISHEYE": (170.0, 160.0, 120.0, -0.03, 0.01),
    "SIMPLE_FISHEYE": (150.0, 160.0, 120.0),
    "FISHEYE": (160.0, 164.0, 161.0, 118.0),
}
"""Parameters in COLMAP's order, for pictures of WIDTH by HEIGHT; displacements of 5 to 60 pixels."""


def read(model: str, parameters: tuple[float, ...], width: int = WIDTH, height: int = HEIGHT) -> Intrinsics:
    """As a COLMAP model is read."""
    return intrinsics_of(ColmapCamera(model, width, height, parameters), "camera 1", "undistort it")


def judge(model: str, parameters: tuple[float, ...], width: int = WIDTH, height: int = HEIGHT) -> Any:
    """The same camera in pycolmap."""
    pycolmap = pytest.importorskip("pycolmap", reason="the judge of lenses, pycolmap, is in the dev extra")
    return pycolmap.Camera(model=model, width=width, height=height, params=list(parameters))


def undistorted(camera: Any) -> Any:
    """The camera that COLMAP's image_undistorter chooses."""
    import pycolmap

    return pycolmap.undistort_camera(pycolmap.UndistortCameraOptions(), camera)


@st.composite
def cameras(draw: st.DrawFn, strong: bool = False) -> tuple[str, tuple[float, ...]]:
    """A model and parameters: half angles to the corner of 25 to 45 degrees, coefficients as calibrations give them,
    or ``strong`` ones of lenses that are no fisheyes, which may fold something over."""
    names = [name for name in sorted(REAL) if not (strong and "FISHEYE" in name)]
    model = MODELS_BY_NAME[draw(st.sampled_from(names))]
    focals = [draw(st.floats(240.0, 400.0)) for _ in range(model.focals)]
    center = [draw(st.floats(0.42, 0.58)) * WIDTH, draw(st.floats(0.42, 0.58)) * HEIGHT]
    spread = {"k1": 0.6 if strong else 0.06, "k2": 0.3 if strong else 0.02, "p1": 0.004, "p2": 0.004}
    names = (model.coefficients or "").split()
    return model.name, (*focals, *center, *(draw(st.floats(-s, s)) for s in (spread.get(n, 0.02) for n in names)))


def pixel_grid(width: int = WIDTH, height: int = HEIGHT, step: int = 1) -> np.ndarray:
    """Centres of pixels, [H W 2]."""
    return np.stack(np.meshgrid(np.arange(0.5, width, step), np.arange(0.5, height, step)), -1)
