"""A scene as a lens would have photographed it (``bent``), and as the pinhole that stands in for that lens
(``straight``): the same cameras and pixels, one resampling fewer. Both are made of the scene's own photographs.

    python tests/distorted_copies.py SCENE MODEL OUT
"""

import json
import shutil
import struct
import sys
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from PIL import Image
from scipy import ndimage

from ringlight.data.colmap_binary import read_cameras
from ringlight.data.colmap_model import CAMERA_MODELS, MODELS_BY_NAME, ColmapCamera, intrinsics_of
from ringlight.data.intrinsics import Intrinsics
from ringlight.data.undistort import undistortion_of

COEFFICIENTS = {
    "SIMPLE_RADIAL": (-0.08,),
    "RADIAL": (0.09, 0.03),
    "OPENCV": (-0.15, 0.04, 0.002, -0.003),
    "FULL_OPENCV": (0.31, 0.12, -0.001, 0.002, 0.02, 0.52, 0.08, 0.01),
    "OPENCV_FISHEYE": (0.03, -0.01, 0.004, -0.001),
    "SIMPLE_RADIAL_FISHEYE": (0.04,),
    "RADIAL_FISHEYE": (-0.03, 0.01),
}
"""As calibrations of telephones, action cameras and fisheye lenses give them, in COLMAP's order."""

ZOOM_STEP, MOST_ZOOM = 0.02, 2.0
"""A bent frame shows more than a straight one: its focal length grows until it lies within the photograph."""

SHRUNK = 2
"""A COLMAP scene's photographs are shrunk by this first, so that they are sharp to the pixel."""


@dataclass(frozen=True)
class Lenses:
    """``bent``, of COLMAP's ``parameters``, and ``straight`` are made of photographs ``taken`` with a pinhole."""

    model: str
    taken: Intrinsics
    bent: Intrinsics
    straight: Intrinsics
    parameters: tuple[float, ...]


def lenses_for(taken: Intrinsics, model: str, inside: bool) -> Lenses:
    """``inside``: whether the bent frame may show nothing beyond the photograph."""
    kind, size = MODELS_BY_NAME[model], (taken.width, taken.height)
    for zoom in np.arange(1, MOST_ZOOM, ZOOM_STEP):
        focal = tuple(zoom * length for length in taken.focal[: kind.focals])
        parameters = (*focal, *taken.center, *COEFFICIENTS[model])
        bent = intrinsics_of(ColmapCamera(model, *size, parameters), model, "")
        places = places_in(bent, taken)
        if not inside or ((places >= 0.5) & (places <= np.array(size) - 0.5)).all():
            made = undistortion_of(bent, model)
            assert made is not None
            return Lenses(model, taken, bent, made.pinhole, parameters)
    raise ValueError(f"{model} shows more than the photograph at any zoom")


def places_in(made: Intrinsics, taken: Intrinsics) -> np.ndarray:
    """Where in a photograph of the pinhole ``taken`` the pixels of ``made`` lie; [H W 2]."""
    x, y = np.arange(made.width) + 0.5, np.arange(made.height) + 0.5
    pixels = np.stack(np.meshgrid(x, y), -1)
    rays = made.lens.straightened(((pixels - made.center) / made.focal).reshape(-1, 2))
    return rays.reshape(pixels.shape) * taken.focal + taken.center


def resampler(places: np.ndarray) -> Callable[[Image.Image], Image.Image]:
    """By splines of degree five, sharper than the loader's, so that the copies and not the copying are measured."""
    at = [places[..., 1] - 0.5, places[..., 0] - 0.5]

    def resample(photograph: Image.Image) -> Image.Image:
        pixels = np.array(photograph).astype(float)
        beyond = "mirror"
        if pixels.shape[2] == 4:
            pixels[..., :3] *= pixels[..., 3:] / 255
            beyond = "constant"  # transparent
        planes = np.moveaxis(pixels, -1, 0)
        colors = np.stack([ndimage.map_coordinates(plane, at, order=5, mode=beyond) for plane in planes], -1)
        if colors.shape[2] == 4:
            colors[..., :3] *= 255 / np.maximum(colors[..., 3:], 0.5)
        return Image.fromarray(np.clip(np.rint(colors), 0, 255).astype(np.uint8))

    return resample


def copy_blender(source: Path, model: str, out: Path, every: int = 1) -> None:
    """A NeRF-Synthetic folder, its subject in the middle of transparent photographs; one training view in ``every``,
    and one test view in twice as many."""
    document = json.loads((source / "transforms_train.json").read_text())
    first = source / f"{document['frames'][0]['file_path']}.png"
    with Image.open(first) as photograph:
        width, height = photograph.size
    focal = 0.5 * width / np.tan(0.5 * document["camera_angle_x"])
    lenses = lenses_for(Intrinsics((focal, focal), (width / 2, height / 2), width, height), model, inside=False)
    names = (MODELS_BY_NAME[model].coefficients or "").split()
    coefficients = {"camera_model": model, **dict(zip(names, COEFFICIENTS[model], strict=True))}
    for name, made, lens in (("bent", lenses.bent, coefficients), ("straight", lenses.straight, {})):
        resample = resampler(places_in(made, lenses.taken))
        for split, apart in (("train", every), ("test", 2 * every)):
            document = json.loads((source / f"transforms_{split}.json").read_text())
            frames = document["frames"][::apart]
            for frame in frames:
                path = out / name / f"{frame['file_path']}.png"
                path.parent.mkdir(parents=True, exist_ok=True)
                with Image.open(source / f"{frame['file_path']}.png") as photograph:
                    resample(photograph.convert("RGBA")).save(path, compress_level=1)
            pinhole = {"fl_x": made.focal[0], "fl_y": made.focal[1], "cx": made.center[0], "cy": made.center[1]}
            document = {**pinhole, "w": made.width, "h": made.height, **lens, "frames": frames}
            (out / name / f"transforms_{split}.json").write_text(json.dumps(document))


def copy_colmap(source: Path, model: str, out: Path) -> None:
    """A COLMAP folder of one pinhole and photographs with the same sizes."""
    sparse = Path("sparse") / "0"
    cameras = read_cameras(source / sparse / "cameras.bin")
    camera = next(iter(cameras.values()))
    whole = intrinsics_of(camera, "the scene", "")
    taken = whole.resized(camera.width // SHRUNK, camera.height // SHRUNK)
    lenses = lenses_for(taken, model, inside=True)
    pinhole = (*lenses.straight.focal, *lenses.straight.center)
    copies = (("bent", lenses.bent, model, lenses.parameters), ("straight", lenses.straight, "PINHOLE", pinhole))
    for name, made, written, parameters in copies:
        (out / name / sparse).mkdir(parents=True)
        (out / name / "images").mkdir()
        for file in ("images.bin", "points3D.bin"):
            shutil.copyfile(source / sparse / file, out / name / sparse / file)
        number = next(number for number, kind in CAMERA_MODELS.items() if kind.name == written)
        records = struct.pack("<Q", len(cameras))
        for camera_id in cameras:
            layout = f"<IiQQ{len(parameters)}d"
            records += struct.pack(layout, camera_id, number, made.width, made.height, *parameters)
        (out / name / sparse / "cameras.bin").write_bytes(records)
        resample = resampler(places_in(made, taken))
        for path in sorted((source / "images").iterdir()):
            with Image.open(path) as photograph:
                small = photograph.convert("RGB").resize((taken.width, taken.height), Image.Resampling.LANCZOS)
            resample(small).save(out / name / "images" / f"{path.stem}.png", compress_level=1)


def copy_scene(source: Path, model: str, out: Path) -> None:
    """Either kind of folder."""
    (copy_colmap if (source / "sparse").is_dir() else copy_blender)(source, model, out)


if __name__ == "__main__":
    copy_scene(Path(sys.argv[1]), sys.argv[2], Path(sys.argv[3]))
