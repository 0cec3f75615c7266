"""Whether a claim of the paper is reproduced: by one rule, from our records."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from statistics import fmean
from typing import Literal

from ringlight.measure.claim_records import LPIPS, Record, Subject, joined
from ringlight.measure.claims import Claim, Paper

Word = Literal["reproduced", "not reproduced", "cannot be tested"]

RATIOS = ("megabytes", "fps", "minutes")
"""Measures that are held against each other by their ratio; the others by their difference."""

NOISE: Mapping[str, float] = {
    "psnr": 0.1, "ssim": 0.001, "lpips": 0.002, "megabytes": 0.05, "fps": 0.1, "minutes": 0.1,
}  # fmt: skip
"""What seeds, or for seconds a machine's other work, change: dB, and logarithms of ratios."""

SHARE = 0.5
"""Of the paper's difference that ours must have."""

MORE_IS_BETTER = ("psnr", "ssim", "fps")
"""The others are the better the less they are."""

TIMES = ("fps", "minutes")
"""Measures that compare on one machine alone."""

LEAST_STEPS = 7_000
"""A shorter run decides nothing: what has 30,000 steps of schedule is starved in it."""

RULE = (
    f"A claim is a difference between two rows (for sizes and times a ratio). It is *reproduced* where ours, as a mean "
    f"over our scenes of that data set, is at least {SHARE:.0%} of the paper's in the same direction, or as near to it "
    f"as seeds are to each other ({NOISE['psnr']:g} dB, {NOISE['ssim']:g} of SSIM, {NOISE['lpips']:g} of LPIPS, "
    f"{NOISE['megabytes']:.0%} of a size, {NOISE['fps']:.0%} of a time), else *not reproduced*. Where the paper's row "
    f"is behind the other, ours may be {1 / SHARE:g} times as far behind at most (a ratio its square). It *cannot be "
    f"tested* where there are no records of both with at least {LEAST_STEPS:,} steps and the same scene, steps, seeds "
    "and kind of record, of times also of one machine with as many threads; the longest count, and shorter ones are "
    "shown all the same."
)


@dataclass(frozen=True)
class Verdict:
    """Of one measure of a claim: the paper's effect and ours, None without records; ratios for sizes and times. What
    runs say that are too short is shown, and decides nothing."""

    word: Word
    paper: float
    ours: float | None


@dataclass(frozen=True)
class Judged:
    """A claim, its verdicts by measure, and what they rest on, or why there is nothing."""

    claim: Claim
    verdicts: Mapping[str, Verdict]
    because: str


def judged(claim: Claim, paper: Paper, records: Sequence[Record]) -> Judged:
    """By the longest records of both on each scene of the data set."""
    study = claim.table.study
    own, other = Subject(study, claim.own.subject), Subject(study, claim.other.subject)
    scenes = paper.data_sets[claim.data_set].scenes
    timed = claim.values.keys() <= set(TIMES)
    pairs = [pair for scene in scenes if (pair := _pair(scene, own, other, records, timed)) is not None]
    long = [pair for pair in pairs if pair[0].steps >= LEAST_STEPS]
    shown, decides = long or pairs, bool(long)
    verdicts = {name: _verdict(name, values, shown, decides) for name, values in claim.values.items()}
    return Judged(claim, verdicts, _because(long, pairs, own, other, records, scenes, timed))


def _pair(
    scene: str, own: Subject, other: Subject, records: Sequence[Record], timed: bool
) -> tuple[Record, Record] | None:
    """Both on the scene, of one kind of record, with the same seeds, if ``timed`` of one machine too; of several the
    longest, then the most telling."""
    groups = dict.fromkeys((record.kind, record.machine if timed else None) for record in records)
    lengths = sorted({record.steps for record in records}, reverse=True)
    for steps in lengths:
        for kind, machine in groups:
            here = [r for r in records if (r.scene, r.steps, r.kind) == (scene, steps, kind)]
            if timed:
                here = [r for r in here if r.machine is not None and r.machine == machine]
            ours, theirs = ([r for r in here if r.subject == subject] for subject in (own, other))
            common = {r.seeds for r in ours} & {r.seeds for r in theirs}
            if common:
                return tuple(joined([r for r in of if r.seeds in common]) for of in (ours, theirs))  # type: ignore[return-value]
    return None


def _effect(name: str, own: float, other: float) -> float:
    return math.log(own / other) if name in RATIOS else own - other


def _verdict(name: str, values: tuple[float, float], pairs: Sequence[tuple[Record, Record]], decides: bool) -> Verdict:
    claimed = _effect(name, *values)
    if name in TIMES:
        pairs = [(a, b) for a, b in pairs if a.machine is not None and a.machine == b.machine]
    # Two networks' distances are no difference between methods: one that both rows have, on most scenes.
    known = max((_known(kind, pairs) for kind in (LPIPS if name == "lpips" else (name,))), key=len)
    shown = math.exp(claimed) if name in RATIOS else claimed
    if not known:
        return Verdict("cannot be tested", shown, None)
    ours = fmean(_effect(name, *pair) for pair in known)
    is_behind = (claimed > 0) != (name in MORE_IS_BETTER)
    most = 1 / SHARE if is_behind else math.inf
    holds = abs(ours - claimed) <= NOISE[name] or (SHARE <= ours / claimed <= most if claimed else False)
    word: Word = ("reproduced" if holds else "not reproduced") if decides else "cannot be tested"
    return Verdict(word, shown, math.exp(ours) if name in RATIOS else ours)


def _known(kind: str, pairs: Sequence[tuple[Record, Record]]) -> list[tuple[float, float]]:
    return [(a.values[kind], b.values[kind]) for a, b in pairs if a.values.get(kind) and b.values.get(kind)]


def _because(
    long: Sequence[tuple[Record, Record]],
    pairs: Sequence[tuple[Record, Record]],
    own: Subject,
    other: Subject,
    records: Sequence[Record],
    scenes: Sequence[str],
    timed: bool,
) -> str:
    told = "; ".join(_told(a, b) for a, b in long or pairs)
    if told:
        return told if long else f"too short to decide: {told}"
    missing = [
        subject.name for subject in (own, other) if not any(r.subject == subject and r.scene in scenes for r in records)
    ]
    if missing:
        return f"no record of {' and '.join(missing)} on these scenes"
    return "no records of both with the same steps and seeds" + (", of one machine" if timed else "")


def _told(own: Record, other: Record) -> str:
    seeds, files = ", ".join(map(str, own.seeds)), ", ".join(dict.fromkeys((own.file, other.file)))
    return f"{own.scene}, {own.steps:,} steps, seeds {seeds} ({files})"
