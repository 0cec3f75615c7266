"""From a folder of posed photographs to a Scene: each format is asked in turn."""

from dataclasses import replace
from pathlib import Path
from types import ModuleType

from ringlight.core.lost_disk import what_helps
from ringlight.core.scene import Scene
from ringlight.data import blender, colmap, nerfstudio
from ringlight.data.kept_pixels import Keeper
from ringlight.data.options import FOUND, UNUSED, SceneOptions
from ringlight.data.splits import spelled_out
from ringlight.data.unposed import remedy_without_cameras
from ringlight.errors import SceneError

FORMATS: dict[str, ModuleType] = {"colmap": colmap, "blender": blender, "nerfstudio": nerfstudio}
"""Format modules in the order in which they are asked: each has LOOKS_FOR, recognises(folder), load(folder, options,
keeper).
"""

MOST_NAMED = 5
"""Scenes that a sentence names."""


def load_scene(path: str | Path, options: SceneOptions | None = None, keeper: Keeper | None = None) -> Scene:
    """The scene in a folder: cameras, lazy photographs, a split, points to start from.

    >>> scene = load_scene("data/garden")                                   # COLMAP, Blender or nerfstudio
    >>> scene = load_scene("data/garden", SceneOptions(downscale=4))        # takes images_4 if it is there
    >>> scene.train[0].image(scene.background_color)                        # decoded now: [3 H W] in [0, 1]
    >>> scene.notes                                                         # filter, split, origin of the points

    Only headers of image files are read; pixels are decoded when a view is first asked for its image, which is also
    when a damaged image raises. Undistorted photographs are asked of ``keeper`` first, and given to it.

    Raises:
        SceneError: one sentence on what cannot be read, where, and the remedy.
        RecipeError: ``options`` shrink a photograph to fewer pixels than show anything.
    """
    folder, options = Path(path), options or SceneOptions()
    try:
        if folder.is_file():
            remedy = remedy_without_cameras(folder) or f"give the folder that holds it: {folder.parent}"
            raise SceneError(f"{folder}: is a file, not a folder; {remedy}")
        if not folder.is_dir():
            raise SceneError(f"{folder}: no such folder; check the path")
        module = _format_of(folder, options)
        if options.photos != FOUND and module is not colmap:
            raise SceneError(f"{folder}: {module.LOOKS_FOR} names the photographs; leave --photos {options.photos} out")
        return module.load(folder, options, keeper)
    except OSError as error:
        reason = error.strerror or type(error).__name__
        check = what_helps(error, "check the path and its permissions")
        raise SceneError(f"{error.filename or folder}: cannot be read ({reason}); {check}") from error


def kept_options(path: Path, options: SceneOptions) -> SceneOptions:
    """The same options wherever and whenever the scene is read again: a list of test images as its names, a folder that
    is not the scene's own by its full path. Raises SceneError for a list that cannot be read."""
    holdout = None if options.holdout is None else spelled_out(options.holdout)
    masks, photos = (_kept_folder(path, named) for named in (options.masks, options.photos))
    return replace(options, masks=masks, photos=photos, holdout=holdout)


def with_absent_masks_left_out(options: SceneOptions, scene: Scene) -> SceneOptions:
    """The same where ``scene``, which was read by them, has masks; else none are looked for when it is read again."""
    if options.masks == FOUND and not any(view.has_alpha for view in (*scene.train, *scene.test)):
        return replace(options, masks=UNUSED)
    return options


def _kept_folder(path: Path, named: str) -> str:
    return named if named in (FOUND, UNUSED) or (path / named).is_dir() else str(Path(named).resolve())


def has_cameras(folder: Path) -> bool:
    """Whether any format recognises the folder."""
    return folder.is_dir() and any(module.recognises(folder) for module in FORMATS.values())


def format_of(folder: Path, options: SceneOptions) -> str:
    """The name of the format as which the folder is read. Raises SceneError where it is none."""
    module = _format_of(folder, options)
    return next(name for name, known in FORMATS.items() if known is module)


def _format_of(folder: Path, options: SceneOptions) -> ModuleType:
    asked = FORMATS if options.format == "auto" else {options.format: FORMATS[options.format]}
    for module in asked.values():
        if module.recognises(folder):
            return module
    looked_for = ", ".join(module.LOOKS_FOR for module in asked.values())
    other = next((name for name, module in FORMATS.items() if module.recognises(folder)), None)
    remedy = f"it looks like --format {other}" if other else _scenes_near(folder, list(asked.values()))
    raise SceneError(f"{folder}: no cameras found; looked for {looked_for}; {remedy}")


def _scenes_near(folder: Path, modules: list[ModuleType]) -> str:
    """The remedy: the folder above where that is a scene, else the scenes inside."""
    above = folder.resolve().parent
    if any(module.recognises(above) for module in modules):
        return f"give the folder above, which has cameras: {above}"
    inside = [path for path in sorted(folder.iterdir()) if any(module.recognises(path) for module in modules)]
    if not inside:
        return remedy_without_cameras(folder) or "give the folder that holds one of them"
    return f"give a scene inside it: {', '.join(map(str, inside[:MOST_NAMED]))}" + (
        ", ..." * (len(inside) > MOST_NAMED)
    )
