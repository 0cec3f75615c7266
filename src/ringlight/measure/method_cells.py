"""What runs of methods on scenes measured, cell by cell; only runs that compare share a scene's row."""

from collections import Counter
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from statistics import fmean

from ringlight.measure.report import Report
from ringlight.measure.study_table import Spread

Measured = Mapping[tuple[str, str], Mapping[int, Report]]
"""Reports by seed, by (scene, method)."""


@dataclass(frozen=True)
class Measure:
    """One table's number: ``key`` names it in files, ``digits`` are shown. ``of_machine``: it goes by the machine, its
    cores and threads, and runs of several are not ranked by it."""

    key: str
    title: str
    unit: str
    digits: int
    more_is_better: bool
    of: Callable[[Report], float | None]
    of_machine: bool = False


MEASURES = (
    Measure("psnr", "PSNR", "dB", 2, True, lambda r: r.psnr),
    Measure("ssim", "SSIM", "", 4, True, lambda r: r.ssim_same),
    Measure("lpips_alex", "LPIPS (alex)", "", 4, False, lambda r: r.lpips_alex),
    Measure("lpips_vgg", "LPIPS (vgg)", "", 4, False, lambda r: r.lpips_vgg),
    Measure("raw_megabytes", "Size, raw", "MB", 2, False, lambda r: r.bytes_raw / 1e6),
    Measure("file_megabytes", "Size, file", "MB", 2, False, lambda r: r.bytes_file / 1e6 if r.bytes_file else None),
    Measure("count", "Gaussians or voxels", "", 0, False, lambda r: r.counted),
    Measure("core_seconds", "Training, CPU", "s", 1, False, lambda r: r.core_seconds),
    Measure("wall_seconds", "Training, wall", "s", 1, False, lambda r: r.train_seconds, of_machine=True),
    Measure("fps", "Frames per second", "", 1, True, lambda r: r.fps, of_machine=True),
)
"""All tables, in their order. MB are 10^6 bytes. CPU seconds include those by which a method chose."""


@dataclass(frozen=True)
class MethodCells:
    """All cells that compare. ``seeds`` were asked for; ``notes`` say what is missing, and why, a sentence each."""

    scenes: tuple[str, ...]
    methods: tuple[str, ...]
    seeds: tuple[int, ...]
    reports: Measured
    notes: tuple[str, ...]

    def cell(self, measure: Measure, scene: str, method: str) -> Spread | None:
        """Over the seeds that are there; None where there is none, or one of them was not measured so."""
        values = [measure.of(report) for report in self.reports.get((scene, method), {}).values()]
        known = [value for value in values if value is not None]
        return Spread.of(known) if known and len(known) == len(values) else None

    def common_scenes(self, measure: Measure) -> tuple[str, ...]:
        """Those for which each method that has any run has this number, with the same seeds."""
        return tuple(
            scene
            for scene in self.scenes
            if all(self.cell(measure, scene, method) for method in self.measured)
            and len({frozenset(self.reports[scene, method]) for method in self.measured}) == 1
        )

    @property
    def measured(self) -> tuple[str, ...]:
        """The methods that have any run."""
        there = {method for _, method in self.reports}
        return tuple(method for method in self.methods if method in there)

    def mean(self, measure: Measure, method: str) -> Spread | None:
        """Over the common scenes: the mean of each seed is taken over scenes, and the spread over seeds of that."""
        scenes = self.common_scenes(measure) if method in self.measured else ()
        shared = set.intersection(*(set(self.reports[scene, method]) for scene in scenes)) if scenes else set()
        if not shared:
            return None
        return Spread.of(
            [fmean(measure.of(self.reports[scene, method][seed]) or 0.0 for scene in scenes) for seed in sorted(shared)]
        )

    def ranks(self, measure: Measure, spreads: Mapping[str, Spread | None]) -> dict[str, int]:
        """1 for the best and 2 for the second of these methods, as far as the shown digits tell them apart; none where
        all are alike, or machines count and are not."""
        if measure.of_machine and len(self.machines) > 1:
            return {}
        shown = {name: round(spread.mean, measure.digits) for name, spread in spreads.items() if spread is not None}
        order = sorted(set(shown.values()), reverse=measure.more_is_better)
        if len(order) < 2:
            return {}
        return {name: order.index(value) + 1 for name, value in shown.items() if value in order[:2]}

    @property
    def machines(self) -> frozenset[tuple[object, ...]]:
        """What speed depends on, of each run that is there."""
        used = (report.machine for by_seed in self.reports.values() for report in by_seed.values())
        return frozenset((m.cpu, m.cores, m.threads, m.isa, m.gpu) for m in used)

    def shown(self) -> tuple[Measure, ...]:
        """The measures that any run has."""
        return tuple(m for m in MEASURES if any(self.cell(m, s, n) for s in self.scenes for n in self.methods))


def cells_of(
    scenes: Sequence[str],
    methods: Sequence[str],
    seeds: Sequence[int],
    reports: Measured,
    reasons: Mapping[tuple[str, str, int], str],
) -> MethodCells:
    """The cells of these runs; ``reasons`` say of runs without a report why there is none."""
    kept: dict[tuple[str, str], dict[int, Report]] = {}
    notes = []
    for scene in scenes:
        of_scene = [report for method in methods for report in reports.get((scene, method), {}).values()]
        agreed = Counter(map(_terms, of_scene)).most_common(1)[0][0] if of_scene else None
        for method in methods:
            for seed in seeds:
                name = f"{scene}, {method}, seed {seed}"
                report = reports.get((scene, method), {}).get(seed)
                if report is None:
                    notes.append(f"{name} is missing: {reasons.get((scene, method, seed), 'it was not run')}.")
                elif _terms(report) != agreed:
                    notes.append(f"{name} is left out: it has {_difference(report, agreed)}.")
                else:
                    kept.setdefault((scene, method), {})[seed] = report
                    notes += [f"{name}: {sentence}" for sentence in _to_know(report)]
    notes += sorted({r.lpips_note for by_seed in kept.values() for r in by_seed.values() if r.lpips_note})
    return MethodCells(tuple(scenes), tuple(methods), tuple(seeds), kept, tuple(notes))


def _to_know(report: Report) -> Iterator[str]:
    """What its numbers do not tell, a sentence each."""
    if report.test_views_trained_on:
        yield f"it was trained on {report.test_views_trained_on} of the {len(report.images)} test views."
    yield from (f"{sentence}." for sentence in report.collapses)


TERMS = ("views", "size", "background", "steps")
"""In which runs of a scene must agree."""


def _terms(report: Report) -> tuple[object, ...]:
    names = tuple(sorted(image.name for image in report.images))
    return ((report.split, names), report.resolution, report.background, report.iterations)


def _difference(report: Report, agreed: tuple[object, ...] | None) -> str:
    """In what it differs from the others of its scene."""
    mine = (report.split, report.resolution, report.background, f"{report.iterations:,}")
    differing = [at for at, term in enumerate(_terms(report)) if agreed is None or term != agreed[at]]
    return " and ".join(f"other {TERMS[at]} ({mine[at]}) than the others" for at in differing)
