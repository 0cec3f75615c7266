"""Flags that were given and decide nothing for the scene at hand: said, because their effect would be missed."""

from operator import attrgetter
from typing import TYPE_CHECKING

from ringlight.core.words import counted
from ringlight.data.options import SceneOptions
from ringlight.methods.recipe import Recipe
from ringlight.methods.surface_start import FEWEST_FOR_DISCS, FEWEST_VIEWS, SurfaceStart
from ringlight.methods.table import METHODS

if TYPE_CHECKING:
    from ringlight.runs.session import Session


def settings_without_effect(asked: SceneOptions, recipe: Recipe, session: "Session") -> list[str]:
    """A sentence on each, of what a new run was asked for and how it begins."""
    preset = METHODS[session.record.preset]
    of_start = [*_of_random_points(asked, session), *_of_surface(recipe, preset, session)]
    return [*of_start, *_of_other_settings(recipe, preset)]


def _of_random_points(asked: SceneOptions, session: "Session") -> list[str]:
    if asked.initial_points is None and asked.points_seed == SceneOptions.points_seed:
        return []
    begins = session.training.model.counted()
    if session.record.start is not None:
        reason = f"the run starts from {session.record.start}"
    elif session.scene.points.measured:
        reason = f"the scene brings {counted(len(session.scene.points.positions), 'point')}"
    elif begins.number != len(session.scene.points.positions):
        reason = f"the run begins with {begins} on or in a hull carved from the photographs"
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
    points = None if start.points in (0, usual.points) else start.points
    opacity = None if start.opacity == usual.opacity else start.opacity
    form = None if start.form == usual.form else start.form
    if _begins_elsewhere(session):
        flags = {"--start.points": points, "--start.opacity": opacity, "--start.form": form}
        reason = _why_not_carved(session, start)
    else:
        faint = start.for_photographs(len(session.scene.train)).form == "balls"
        flags = {"--start.opacity": opacity if faint else None}
        few = f"with fewer than {FEWEST_FOR_DISCS} photographs Gaussians start as faint balls"
        reason = few if start.form is None else "--start.form is balls"
    return [f"{flag} {value} has no effect: {reason}" for flag, value in flags.items() if value is not None]


def _of_other_settings(recipe: Recipe, preset: Recipe) -> list[str]:
    """Of settings that others, such as the kind of density control, make idle; those that the ``preset`` has too were
    not asked for."""
    return [
        f"{_flag(setting, attrgetter(setting)(recipe))} has no effect: {reason}"
        for setting, reason in recipe.without_effect().items()
        if attrgetter(setting)(recipe) != attrgetter(setting)(preset)
    ]


def _flag(setting: str, value: object) -> str:
    """As it was given: "--densify.threshold 0.001", "--densify.no-pixel-bound"."""
    group, dot, name = setting.replace("_", "-").rpartition(".")
    if isinstance(value, bool):
        return f"--{group}{dot}{name}" if value else f"--{group}{dot}no-{name}"
    return f"--{group}{dot}{name} {value:g}" if isinstance(value, float) else f"--{group}{dot}{name} {value}"


def _begins_elsewhere(session: "Session") -> bool:
    """Than on the hull."""
    splats, points = session.training.model.splats(), session.scene.points.positions
    if session.record.start is not None or splats is None:
        return True
    means = splats.gaussians.means.detach().cpu()
    return means.shape == points.shape and bool((means == points).all())


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
