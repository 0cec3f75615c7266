"""3D Gaussian scenes lit by one shared light field.

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
    from ringlight.color.contract import ColorModel as ColorModel
    from ringlight.core.camera import Camera as Camera
    from ringlight.core.gaussians import Gaussians as Gaussians
    from ringlight.core.rendering import Rendering as Rendering
    from ringlight.core.scene import PointCloud as PointCloud
    from ringlight.core.scene import Scene as Scene
    from ringlight.core.scene import View as View
    from ringlight.data.load import load_scene as load_scene
    from ringlight.data.options import SceneOptions as SceneOptions
    from ringlight.errors import RinglightError as RinglightError
    from ringlight.files.bake import bake_to_sh as bake_to_sh
    from ringlight.files.ply import read_gaussian_ply as read_gaussian_ply
    from ringlight.files.ply import write_gaussian_ply as write_gaussian_ply
    from ringlight.fit.strategies.contract import Strategy as Strategy
    from ringlight.fit.train import Training as Training
    from ringlight.fit.train import train as train
    from ringlight.measure.compare import compare as compare
    from ringlight.measure.evaluate import evaluate as evaluate
    from ringlight.methods.store import load_model as load_model
    from ringlight.methods.store import save_model as save_model
    from ringlight.methods.table import METHODS as METHODS
    from ringlight.models.splats import SplatModel as SplatModel
    from ringlight.rasterize.choose import rasterizer_for as rasterizer_for
    from ringlight.rasterize.contract import Rasterizer as Rasterizer
    from ringlight.rasterize.contract import RasterOptions as RasterOptions
    from ringlight.shade.contract import Shader as Shader

__all__ = [*_HOMES]


def __getattr__(name: str) -> Any:
    if name not in _HOMES:
        raise AttributeError(f"module 'ringlight' has no attribute {name!r}")
    value = getattr(import_module(f"ringlight.{_HOMES[name]}"), name)
    globals()[name] = value
    return value


def __dir__() -> list[str]:
    return [*__all__, "__version__"]
