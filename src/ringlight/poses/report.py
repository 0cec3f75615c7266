"""What finding the cameras came to: how many, how well, and why the others were not found."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from ringlight.core.words import counted
from ringlight.poses.database import Matches

FEW_FEATURES = 50
"""Below this a photograph shows hardly anything."""

MOST_NAMED = 12
"""Failed photographs that a text names."""


@dataclass(frozen=True)
class Failure:
    """A photograph that got no camera."""

    name: str
    reason: str


@dataclass(frozen=True)
class PosesReport:
    """``models`` are the photographs in each reconstruction, the largest first, which is the one that was written;
    the reprojection error is a mean over its observations, pixels; seconds are those of the last run of each stage."""

    scene: str
    photographs: int
    registered: int
    reprojection_error: float
    points: int
    track_length: float
    models: tuple[int, ...]
    mapper: str
    matching: str
    pairs: int
    lenses: tuple[str, ...]
    up: str
    picture: str
    failed: tuple[Failure, ...]
    seconds: dict[str, float]

    def lines(self) -> list[str]:
        """For a person."""
        said = [
            f"{self.registered} of {self.photographs} photographs have cameras, mean reprojection error "
            f"{self.reprojection_error:.2f} pixels, {counted(self.points, 'point')} seen {self.track_length:.1f} times "
            "each",
            f"{self.mapper} mapping, {counted(self.pairs, 'pair')} compared ({self.matching}); lens "
            + "; ".join(self.lenses),
            f"up: {self.up}",
        ]
        if len(self.models) > 1:
            counts = ", ".join(map(str, self.models))
            said.append(
                f"warning: the photographs fall into {len(self.models)} models that share no points ({counts} "
                "photographs); the largest is taken: photograph what lies between, or give each subject a folder"
            )
        said += [f"  {failure.name}: {failure.reason}" for failure in self.failed[:MOST_NAMED]]
        if len(self.failed) > MOST_NAMED:
            said.append(f"  and {len(self.failed) - MOST_NAMED} more, in the report")
        return said


def why_not(
    name: str, features: Mapping[str, int], matches: Mapping[str, Matches], models: Sequence[Sequence[str]]
) -> Failure:
    """Why a photograph that was read is not in the largest of the models (each a list of names)."""
    own = next((number for number, names in enumerate(models) if name in names), None)
    count, found = features.get(name, 0), matches.get(name, Matches())
    if own:
        reason = f"belongs to another model, of {len(models[own])} photographs"
    elif count < FEW_FEATURES:
        reason = f"shows too little to recognise ({counted(count, 'feature')}); it may be blurred, dark or plain"
    elif not found.photographs:
        reason = "overlaps with no other photograph"
    else:
        most, others = counted(found.most, "common point"), counted(found.photographs, "photograph")
        reason = f"overlaps too little: {most} at most, with {others}"
    return Failure(name, reason)


def lens_in_words(lens: Mapping[str, Any]) -> str:
    """COLMAP's model, size and parameters."""
    parameters = " ".join(f"{value:.6g}" for value in lens["parameters"])
    return f"{lens['model']} {lens['width']}x{lens['height']} {parameters}"
