"""What a person is told of a scene as soon as it is read, before anything is tried on it."""

import sys
from functools import partial
from typing import TYPE_CHECKING

from ringlight.core.words import counted

if TYPE_CHECKING:
    from ringlight.core.scene import Scene
    from ringlight.runs.start import Loaded

BACKGROUNDS = {"photograph": "background as photographed"}
"""Words for those whose name in files says less."""


def telling_of_scenes(quiet: bool) -> "Loaded":
    """Says what was read; warnings alone, where all else is to be ``quiet``."""
    return partial(_tell, quiet)


def tell_warnings(scene: "Scene") -> None:
    """What must not be missed."""
    for warning in scene.warnings:
        sys.stderr.write(f"warning: {warning}\n")


def _tell(quiet: bool, preset: str, scene: "Scene") -> None:
    tell_warnings(scene)
    if quiet:
        return
    from ringlight.core.scene import WARNING

    camera = scene.train[0].camera
    background = BACKGROUNDS.get(scene.background, f"{scene.background} background")
    lines = [
        f"{preset} on {scene.name} ({scene.format}): {len(scene.train)} training and "
        f"{counted(len(scene.test), 'test view')}, "
        f"{camera.width}x{camera.height}, {background}",
        *(f"  {note}" for note in scene.notes if not note.startswith(WARNING)),
    ]
    sys.stderr.write("\n".join(lines) + "\n")
