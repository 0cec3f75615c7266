"""Scenes on disk under other light: recoloured photographs, or those that a mirror makes of another surrounding.

python tests/relit_scenes.py evening SCENE OUT       photographs of a bundled scene or folder, recoloured
python tests/relit_scenes.py turned RUN SCENE OUT    what the run's mirror shows with its surrounding turned by 90°
"""

import json
import shutil
import sys
from pathlib import Path

import numpy as np
import torch
from PIL import Image

from ringlight.core.want import Want
from ringlight.data.bundled import scene_folder
from ringlight.data.load import load_scene
from ringlight.data.options import SceneOptions
from ringlight.models.splats import SplatModel
from ringlight.runs.opened import open_model
from ringlight.shade.reflection import ReflectionShader

EVENING, CONTRAST = (1.0, 0.75, 0.5), 1.3
"""Factors of red, green and blue, and the power of what was photographed."""

FAINTEST = 1e-3
"""Alpha of pixels that have a colour."""


def evening_scene(scene: Path, out: Path) -> Path:
    """The photographs of a Blender scene under warmer, harder light: each value v as factor v^power."""
    shutil.copytree(scene, out)
    for file in out.rglob("*.png"):
        pixels = np.asarray(Image.open(file).convert("RGBA")) / 255
        pixels = np.concatenate([np.array(EVENING) * pixels[..., :3] ** CONTRAST, pixels[..., 3:]], -1)
        _write(file, pixels)
    return out


@torch.no_grad()
def turned_scene(run: Path, scene: Path, out: Path) -> Path:
    """What the mirror in ``run`` shows from the cameras of a Blender scene with its maps turned by 90° about z."""
    shutil.copytree(scene, out)
    model = open_model(run).stored.model
    assert isinstance(model, SplatModel)
    assert isinstance(model.shader, ReflectionShader)
    for values in model.shader.maps.parameters():
        values.copy_(torch.rot90(values, 1, (0, 1)))
    read = load_scene(scene, SceneOptions())
    for split, views in (("train", read.train), ("test", read.test)):
        frames = json.loads((scene / f"transforms_{split}.json").read_text())["frames"]
        for frame, view in zip(frames, views, strict=True):
            shown = model.render(view.camera, torch.zeros(3), Want.EXACT)
            straight = shown.color / shown.alpha.clamp_min(FAINTEST)
            _write(out / f"{frame['file_path']}.png", torch.cat([straight, shown.alpha], -1).clamp(0, 1).numpy())
    return out


def _write(file: Path, pixels: np.ndarray) -> None:
    Image.fromarray((pixels * 255).round().astype(np.uint8)).save(file)


if __name__ == "__main__":
    match sys.argv[1:]:
        case ["evening", scene, out]:
            evening_scene(scene_folder(Path(scene)), Path(out))
        case ["turned", run, scene, out]:
            turned_scene(Path(run), scene_folder(Path(scene)), Path(out))
        case _:
            sys.exit(__doc__)
