"""Flags that were given and decide nothing for the scene at hand: said, because their effect would be missed."""

from typing import TYPE_CHECKING

from ringlight.core.words import counted
from ringlight.data.options import SceneOptions

if TYPE_CHECKING:
    from ringlight.runs.session import Session


def settings_without_effect(asked: SceneOptions, session: "Session") -> list[str]:
    """A sentence on each, of what a new run was asked for and how it begins."""
    if asked.initial_points is None and asked.points_seed == SceneOptions.points_seed:
        return []
    begins = session.training.model.counted()
    if session.scene.points.measured:
        reason = f"the scene brings {counted(len(session.scene.points.positions), 'point')}"
    elif begins.number != len(session.scene.points.positions):
        reason = f"the run begins with {begins} on a surface carved from the photographs"
    else:
        return []
    flags = {"--initial-points": asked.initial_points, "--points-seed": asked.points_seed or None}
    return [f"{flag} {value} has no effect: {reason}" for flag, value in flags.items() if value is not None]
