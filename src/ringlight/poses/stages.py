"""The stages from photographs to cameras; each keeps what it has found, so that a killed run goes on."""

import json
import shutil
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from ringlight.core.words import counted
from ringlight.errors import SceneError
from ringlight.files.atomic import sweep, write_text
from ringlight.poses.database import FeatureDatabase
from ringlight.poses.film import take_frames
from ringlight.poses.options import PosesOptions
from ringlight.poses.pairs import MOST_EXHAUSTIVE, all_pairs, neighbour_pairs
from ringlight.poses.photographs import SceneFolders, Taken, safe_names, take
from ringlight.poses.process import ask_colmap
from ringlight.poses.report import Failure, why_not

MOST_INCREMENTAL = 400
"""Photographs up to which cameras are added one by one: that time grows faster than their number."""

FEWEST = 3
"""Photographs from which cameras are sought: the model of two can be tested by none."""

Watch = Callable[[str, int, int], None]
"""Called with the stage, what is done and what there is in all (0: not known)."""


@dataclass
class Work:
    """One run: what it was asked, where it works, and what its stages have found."""

    folders: SceneFolders
    options: PosesOptions
    threads: int
    watch: Watch
    is_film: bool = False
    taken: list[Taken] = field(default_factory=list)
    failed: list[Failure] = field(default_factory=list)
    pairs: int = 0
    matching: str = ""
    seconds: dict[str, float] = field(default_factory=dict)

    @contextmanager
    def stage(self, name: str) -> Iterator[Callable[[int, int], None]]:
        """Times a stage, and tells how it gets on."""
        begun = time.monotonic()
        self.watch(name, 0, 0)
        yield lambda done, total: self.watch(name, done, total)
        self.seconds[name] = round(time.monotonic() - begun, 3)

    @property
    def database(self) -> FeatureDatabase:
        """Features and matches."""
        return FeatureDatabase(self.folders.database)


def make_folders(work: Work) -> None:
    """Those that the stages write to, without what killed writers left."""
    folders = work.folders
    for folder in (folders.images, folders.work, folders.masks, folders.over_grey):
        folder.mkdir(exist_ok=True)
        sweep(folder)


def take_photographs(work: Work, source: Path, files: Sequence[Path]) -> None:
    """Choose the frames of a film; check each photograph, and put it where COLMAP finds it.

    Raises:
        SceneError: too few can be read; a film that shows nothing, or does not move.
    """
    folders = work.folders
    if work.is_film:
        frames = folders.work / "frames.json"
        with work.stage("frames") as tell:
            if not frames.exists():
                write_text(frames, json.dumps(take_frames(source, folders.images, work.options.frames, tell)))
        files = [folders.images / name for name in json.loads(frames.read_text())]
    with work.stage("photographs") as tell:
        for index, (path, name) in enumerate(zip(files, safe_names(files), strict=True)):
            try:
                work.taken.append(take(path, name, folders))
            except SceneError as error:
                work.failed.append(Failure(path.name, str(error).removeprefix(f"{path}: ")))
            tell(index + 1, len(files))
    if len(work.taken) < FEWEST:
        raise SceneError(
            f"{source}: only {len(work.taken)} of {counted(len(files), 'photograph')} can be read; "
            f"{work.failed[0].name}: {work.failed[0].reason}"
        )


def seek_features(work: Work) -> None:
    """SIFT of all photographs for which the database has none; those of one lens share a camera."""
    have = work.database.features()
    lenses: dict[tuple[str, ...], list[Taken]] = {}
    for one in work.taken:
        lenses.setdefault(one.lens, []).append(one)
    groups = []
    for same in lenses.values():
        missing = [one.name for one in same if one.name not in have]
        if missing:
            cut_out, folders = same[0].is_cut_out, work.folders
            groups.append(
                {
                    "names": missing,
                    "lens_of": [one.name for one in same],
                    "images": str(folders.over_grey if cut_out else folders.images),
                    "masks": str(folders.masks) if cut_out else None,
                    "model": _lens(work.options, same[0]),
                }
            )
    order = {"groups": groups, "features": work.options.features, "feature_size": work.options.feature_size}
    with work.stage("features") as tell:
        if groups:
            _ask(work, "features", order, tell)


def _lens(options: PosesOptions, one: Taken) -> str:
    if options.lens == "auto":
        return "SIMPLE_PINHOLE" if one.is_cut_out and not one.has_exif_camera else "SIMPLE_RADIAL"
    return options.lens.upper().replace("-", "_")


def compare(work: Work) -> None:
    """Match the pairs that the database has not compared yet."""
    names = [one.name for one in work.taken]
    wish = work.options.matching
    exhaustive = wish == "exhaustive" or (wish == "auto" and len(names) <= MOST_EXHAUSTIVE and not work.is_film)
    with work.stage("pairs") as tell:
        database = work.database
        pairs = all_pairs(names) if exhaustive else neighbour_pairs(names, database.descriptors, work.options.seed)
        compared = database.compared()
        work.pairs, work.matching = len(pairs), "all" if exhaustive else "neighbours, and those that look alike"
        missing = [pair for pair in pairs if pair not in compared]
        if missing:
            _ask(work, "matches", {"pairs": missing}, tell)


def map_photographs(work: Work) -> dict[str, Any]:
    """Solve for the cameras; the largest model takes its place in the scene. Returns the worker's answer.

    Raises:
        SceneError: nothing overlaps.
    """
    made = work.folders.work / "model"
    shutil.rmtree(made, ignore_errors=True)
    wish, few = work.options.mapper, len(work.taken) <= MOST_INCREMENTAL
    mappers = ["incremental", "global"] if few else ["global", "incremental"]
    order = {
        "mappers": mappers if wish == "auto" else [wish],
        "images": str(work.folders.images),
        "model": str(made),
        "photographs": len(work.taken),
        "orientations": {one.name: one.orientation for one in work.taken},
    }
    with work.stage("mapping") as tell:
        answer: dict[str, Any] = _ask(work, "mapping", order, tell)
    if not answer["models"]:
        raise SceneError(_why_nothing(work))
    work.folders.model.parent.mkdir(exist_ok=True)
    shutil.rmtree(work.folders.model, ignore_errors=True)
    made.rename(work.folders.model)
    for mapper in mappers:
        shutil.rmtree(work.folders.work / mapper, ignore_errors=True)
    return answer


def _why_nothing(work: Work) -> str:
    database = work.database
    features, matches = database.features(), database.matches()
    reasons = [why_not(one.name, features, matches, []) for one in work.taken]
    return (
        f"{work.folders.scene}: no cameras are found, since none of the {len(work.taken)} photographs overlap enough "
        f"({reasons[0].name}: {reasons[0].reason}); photograph the subject from all sides, each time with most of what "
        "the last photograph showed"
    )


def _ask(work: Work, task: str, order: dict[str, Any], tell: Callable[[int, int], None]) -> Any:
    common = {
        "database": str(work.folders.database),
        "scratch": str(work.folders.work),
        "threads": work.threads or -1,
        "seed": work.options.seed,
    }
    return ask_colmap(task, common | order, work.folders.work, tell)
