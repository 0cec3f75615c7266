"""Density control as recipes take it: Gaussians are added where they are missing, then the least of them dropped."""

from ringlight.core.scene import Scene
from ringlight.fit.strategies.contract import Strategy
from ringlight.fit.strategies.densify import Densify
from ringlight.fit.strategies.densify_settings import DensifySettings
from ringlight.fit.strategies.drop_least import DropLeast


def density_control(settings: DensifySettings, scene: Scene, steps: int, seed: int) -> tuple[Strategy, ...]:
    """The strategies of a run of so many ``steps`` on the scene's training photographs.

    Without a bound in ``settings`` it is the pixels of the largest of them.
    """
    bounded, white = settings.within(scene.pixels), scene.background == "white"
    return (
        Densify(bounded, scene.extent, steps, seed, white),
        DropLeast(bounded, [view.camera for view in scene.train], steps),
    )
