"""What others make of our PLY: splat-transform reads every column, and its picture agrees with ours.

Runs where splat-transform (npm install --global @playcanvas/splat-transform) is on PATH, or where
RINGLIGHT_SPLAT_TRANSFORM names it. Its pictures need a Vulkan driver: a graphics card's, or the software one that
comes with Chromium (with the package libvulkan1), which is found here.
"""

import math
import os
import shutil
import subprocess
from pathlib import Path

import numpy as np
import pytest
import torch
from PIL import Image

from ringlight.core.camera import Camera
from ringlight.core.directions import view_directions
from ringlight.core.gaussians import Gaussians
from ringlight.core.sh_basis import GREY, sh_basis
from ringlight.files.ply import read_gaussian_ply, write_gaussian_ply
from ringlight.rasterize.contract import RasterOptions
from ringlight.rasterize.reference import ReferenceRasterizer

SOFTWARE_VULKAN = Path("/usr/lib/chromium/vk_swiftshader_icd.json")

WIDTH, HEIGHT, VERTICAL_DEGREES = 160, 120, 60.0

NEAR = 0.2
"""splat-transform's default near plane."""

LARGE, ABOUT_A_PIXEL = (-2.5, 41.0), (-4.5, 49.0)
"""Mean log scale, and the agreement asked for in dB; measured with splat-transform 3.7.0: 43.7 and 52.6.

What remains is its 8-bit picture and where each side cuts off faint alpha. The wrong sign of any one harmonic leaves
at most 35 and 44 dB, a conjugate rotation 26 and 40, coefficients in the wrong order 20 and 29.
"""


def splat_transform(*arguments: str) -> str:
    """Run it and return its standard output; skips where it is missing."""
    program = os.environ.get("RINGLIGHT_SPLAT_TRANSFORM") or shutil.which("splat-transform")
    if not program:
        pytest.skip("needs splat-transform on PATH or in RINGLIGHT_SPLAT_TRANSFORM")
    environment = dict(os.environ)
    if SOFTWARE_VULKAN.exists():
        environment.setdefault("VK_ICD_FILENAMES", str(SOFTWARE_VULKAN))
    done = subprocess.run([program, *arguments], env=environment, capture_output=True, text=True, timeout=120)
    assert done.returncode == 0, done.stdout + done.stderr
    return done.stdout


def random_model(rows: int, log_scale: float) -> Gaussians:
    generator = torch.Generator().manual_seed(1)

    def random(*shape: int) -> torch.Tensor:
        return torch.randn(*shape, generator=generator)

    return Gaussians(
        means=random(rows, 3) * 0.6,
        log_scales=random(rows, 3) * 0.5 + log_scale,
        quats=torch.nn.functional.normalize(random(rows, 4), dim=-1),
        opacity_logits=random(rows) + 1,
        appearance={"sh_dc": random(rows, 3), "sh_rest": random(rows, 15, 3) * 0.3},
    )


def write(path: Path, model: Gaussians) -> None:
    write_gaussian_ply(path, model, model.appearance["sh_dc"], model.appearance["sh_rest"])


def camera_at(position: list[float], target: list[float]) -> Camera:
    """Looking at ``target``; up is -y, as in photographs of COLMAP scenes."""
    forward = torch.nn.functional.normalize(torch.tensor(target) - torch.tensor(position), dim=0)
    right = torch.nn.functional.normalize(torch.linalg.cross(forward, torch.tensor([0.0, -1.0, 0.0])), dim=0)
    matrix = torch.eye(4)
    matrix[:3, :3] = torch.stack([right, torch.linalg.cross(forward, right), forward])
    matrix[:3, 3] = -matrix[:3, :3] @ torch.tensor(position)
    focal = HEIGHT / 2 / math.tan(math.radians(VERTICAL_DEGREES / 2))
    return Camera(matrix, (focal, focal), (WIDTH / 2, HEIGHT / 2), WIDTH, HEIGHT)


def turned(vector: list[float]) -> str:
    """Our coordinates in splat-transform's: it turns every PLY by 180 degrees about z."""
    return f"{-vector[0]},{-vector[1]},{vector[2]}"


def our_picture(model: Gaussians, camera: Camera) -> np.ndarray:
    basis = sh_basis(view_directions(model.means, camera.position), 3)
    coefficients = torch.cat([model.appearance["sh_dc"][:, None], model.appearance["sh_rest"]], 1)
    colors = (torch.einsum("nk,nkc->nc", basis, coefficients) + GREY).clamp_min(0)
    raster = ReferenceRasterizer()(model, colors, camera, torch.ones(3), RasterOptions(near=NEAR))
    return raster.image.clamp(0, 1).numpy()


def test_it_reads_every_column(tmp_path: Path) -> None:
    model = random_model(50, -3.0)
    write(tmp_path / "ours.ply", model)
    splat_transform("--quiet", str(tmp_path / "ours.ply"), str(tmp_path / "theirs.ply"))
    columns = read_gaussian_ply(tmp_path / "theirs.ply").gaussians.columns()
    for name, column in model.columns().items():
        torch.testing.assert_close(columns[name], column, rtol=1e-6, atol=1e-6, msg=name)


@pytest.mark.parametrize("size", [LARGE, ABOUT_A_PIXEL], ids=["large", "about a pixel"])
@pytest.mark.parametrize(
    ("position", "target"),
    [([0.0, 0.0, -4.0], [0.0, 0.0, 0.0]), ([1.5, -2.0, -3.0], [0.2, 0.1, -0.1])],
    ids=["frontal", "oblique"],
)
def test_its_picture_agrees_with_ours(
    tmp_path: Path, position: list[float], target: list[float], size: tuple[float, float]
) -> None:
    if "[0]" not in splat_transform("--list-gpus"):
        pytest.skip("splat-transform's pictures need a Vulkan driver, for instance Chromium's, and libvulkan1")
    log_scale, agreement = size
    model = random_model(300, log_scale)
    write(tmp_path / "ours.ply", model)
    splat_transform(
        "--quiet",
        str(tmp_path / "ours.ply"),
        str(tmp_path / "theirs.webp"),
        f"--camera-pos={turned(position)}",
        f"--camera-target={turned(target)}",
        "--camera-up=0,1,0",
        f"--camera-fov={VERTICAL_DEGREES}",
        f"--resolution={WIDTH}x{HEIGHT}",
        "--background=1,1,1",
    )
    with Image.open(tmp_path / "theirs.webp") as file:
        theirs = np.asarray(file.convert("RGB"), dtype=np.float64) / 255
    error = ((our_picture(model, camera_at(position, target)) - theirs) ** 2).mean()
    assert -10 * math.log10(error) > agreement
