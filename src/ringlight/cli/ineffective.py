"""Flags that were given and decide nothing for the scene at hand: said, because their effect would be missed."""

from operator import attrgetter
from typing import TYPE_CHECKING

from ringlight.core.origin import Origin
from ringlight.core.words import counted
from ringlight.data.options import SceneOptions
from ringlight.methods.recipe import Recipe
from ringlight.methods.surface_start import FEWEST_FOR_DISCS, FEWEST_VIEWS, SurfaceStart
from ringlight.methods.table import METHODS

if TYPE_CHECKING:
    from ringlight.cli.run_training import RunOptions
    from ringlight.runs.session import Session

HULLS: tuple[Origin, ...] = ("hull", "in hull")
"""Where the first Gaussians lie of a run that has carved one."""

ROUNDING = 1e-6
"""Of an opacity that was stored as a logit."""


def idle_settings(recipe: Recipe, preset: Recipe) -> list[str]:
    """A sentence on each setting that others, such as the kind of density control, make idle; what the ``preset`` has
    too was not asked for. Needs no scene."""
    return [
        f"{_flag(setting, attrgetter(setting)(recipe))} has no effect: {reason}"
        for setting, reason in recipe.without_effect().items()
        if attrgetter(setting)(recipe) != attrgetter(setting)(preset)
    ]


def start_without_effect(asked: SceneOptions, recipe: Recipe, session: "Session") -> list[str]:
    """A sentence on each, of where a new run was asked to start."""
    return [*_of_random_points(asked, session), *_of_surface(recipe, METHODS[session.record.preset], session)]


def watching_without_effect(asked: "RunOptions") -> list[str]:
    """A sentence on each flag that watches steps, of a run that has none left."""
    flags = {
        f"--eval-at {' '.join(map(str, asked.eval_at))}": asked.eval_at,
        f"--preview {asked.preview}": asked.preview,
        f"--save-every {asked.save_every or 0:g}": asked.save_every,
        "--tensorboard": asked.tensorboard,
        "--view": asked.view,
    }
    return [f"{flag} has no effect: no step is left to do" for flag, given in flags.items() if given]


def _of_random_points(asked: SceneOptions, session: "Session") -> list[str]:
    origin = session.training.origin
    if session.record.start is not None:
        reason = f"the run starts from {session.record.start}"
    elif session.scene.points.measured:
        reason = f"the scene brings {counted(len(session.scene.points.positions), 'point')}"
    elif session.training.model.splats() is None:
        reason = f"{session.record.preset} starts from no points"
    elif origin in HULLS:
        reason = f"the run begins with {session.training.model.counted()} on or in a hull carved from the photographs"
    else:
        return []
    flags = {"--initial-points": asked.initial_points, "--points-seed": asked.points_seed or None}
    return [f"{flag} {value} has no effect: {reason}" for flag, value in flags.items() if value is not None]


def _of_surface(recipe: Recipe, preset: Recipe, session: "Session") -> list[str]:
    """Of a method that starts on the hull of masks where the scene has some; what its ``preset`` has was not asked
    for."""
    start, usual = recipe.start, preset.start
    if start is None or usual is None:
        return []
    elsewhere = session.record.start is not None or session.training.origin not in HULLS
    flags: dict[str, object] = {}
    if not _begins_with_opacity(session, start.opacity):
        flags["--start.opacity"] = None if start.opacity == usual.opacity else start.opacity
    if elsewhere:
        flags["--start.points"] = None if start.points in (0, usual.points) else start.points
        flags["--start.form"] = None if start.form == usual.form else start.form
    reason = _why_not_carved(session, start) if elsewhere else _why_balls(start)
    return [f"{flag} {value} has no effect: {reason}" for flag, value in flags.items() if value is not None]


def _flag(setting: str, value: object) -> str:
    """As it was given: "--densify.threshold 0.001", "--densify.no-pixel-bound"."""
    group, dot, name = setting.replace("_", "-").rpartition(".")
    if isinstance(value, bool):
        return f"--{group}{dot}{name}" if value else f"--{group}{dot}no-{name}"
    return f"--{group}{dot}{name} {value:g}" if isinstance(value, float) else f"--{group}{dot}{name} {value}"


def _begins_with_opacity(session: "Session", opacity: float) -> bool:
    """Of a new run: whether its first Gaussians have it. Balls have another, and so has what starts from a model."""
    splats = session.training.model.splats()
    if session.record.start is not None or splats is None:
        return False
    first = splats.gaussians.opacity_logits.detach().sigmoid()
    return bool(((first - opacity).abs() < ROUNDING).all())


def _why_balls(start: SurfaceStart) -> str:
    few = f"with fewer than {FEWEST_FOR_DISCS} photographs Gaussians start as faint balls"
    return few if start.form is None else "--start.form is balls"


def _why_not_carved(session: "Session", start: SurfaceStart) -> str:
    views = session.scene.train
    if session.record.start is not None:
        return f"the run starts from {session.record.start}"
    if start.points == 0:
        return "--start.points is 0"
    if not all(view.has_alpha for view in views):
        return "a surface is carved from masks, which not all photographs have"
    if len(views) < FEWEST_VIEWS:
        return f"a surface is carved from {FEWEST_VIEWS} photographs or more, and {len(views)} are to train on"
    return "the masks leave no surface"
