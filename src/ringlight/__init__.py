"""3D Gaussian scenes lit by one shared neural tensor-ring light field.

The public names below are loaded when they are first used: ``import ringlight`` does not import torch.

    import ringlight as rl

    scene = rl.load_scene("my-photos")
    training = rl.METHODS["ringlight"].build(scene, rl.rasterizer_for("auto"), seed=0)
    for progress in rl.train(training):
        ...
"""

import os
from importlib import import_module
from typing import TYPE_CHECKING, Any

# Before torch is imported: its idle OpenMP threads would spin on the cores that our kernels use.
os.environ.setdefault("OMP_WAIT_POLICY", "passive")

__version__ = "0.1.0"

_HOMES = {
    "Camera": "core.camera",
    "ColorModel": "color.contract",
    "Gaussians": "core.gaussians",
    "METHODS": "methods.table",
    "PointCloud": "core.scene",
    "RasterOptions": "rasterize.contract",
    "Rasterizer": "rasterize.contract",
    "Rendering": "core.rendering",
    "RinglightError": "errors",
    "Scene": "core.scene",
    "SceneOptions": "data.options",
    "Shader": "shade.contract",
    "SplatModel": "models.splats",
    "Strategy": "fit.strategies.contract",
    "Training": "fit.train",
    "View": "core.scene",
    "bake_to_sh": "files.bake",
    "compare": "measure.compare",
    "evaluate": "measure.evaluate",
    "load_model": "methods.store",
    "load_scene": "data.load",
    "rasterizer_for": "rasterize.choose",
    "read_gaussian_ply": "files.ply",
    "save_model": "methods.store",
    "train": "fit.train",
    "write_gaussian_ply": "files.ply",
}

if TYPE_CHECKING:
    from ringlight.color.contract import ColorModel
    from ringlight.core.camera import Camera
    from ringlight.core.gaussians import Gaussians
    from ringlight.core.rendering import Rendering
    from ringlight.core.scene import PointCloud, Scene, View
    from ringlight.data.load import load_scene
    from ringlight.data.options import SceneOptions
    from ringlight.errors import RinglightError
    from ringlight.files.bake import bake_to_sh
    from ringlight.files.ply import read_gaussian_ply, write_gaussian_ply
    from ringlight.fit.strategies.contract import Strategy
    from ringlight.fit.train import Training, train
    from ringlight.measure.compare import compare
    from ringlight.measure.evaluate import evaluate
    from ringlight.methods.store import load_model, save_model
    from ringlight.methods.table import METHODS
    from ringlight.models.splats import SplatModel
    from ringlight.rasterize.choose import rasterizer_for
    from ringlight.rasterize.contract import Rasterizer, RasterOptions
    from ringlight.shade.contract import Shader

__all__ = [
    "METHODS",
    "Camera",
    "ColorModel",
    "Gaussians",
    "PointCloud",
    "RasterOptions",
    "Rasterizer",
    "Rendering",
    "RinglightError",
    "Scene",
    "SceneOptions",
    "Shader",
    "SplatModel",
    "Strategy",
    "Training",
    "View",
    "bake_to_sh",
    "compare",
    "evaluate",
    "load_model",
    "load_scene",
    "rasterizer_for",
    "read_gaussian_ply",
    "save_model",
    "train",
    "write_gaussian_ply",
]


def __getattr__(name: str) -> Any:
    if name not in _HOMES:
        raise AttributeError(f"module 'ringlight' has no attribute {name!r}")
    value = getattr(import_module(f"ringlight.{_HOMES[name]}"), name)
    globals()[name] = value
    return value


def __dir__() -> list[str]:
    return [*__all__, "__version__"]
