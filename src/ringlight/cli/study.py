"""``ringlight study ablation|field|rank|feature|gamma|beta|warmup|pareto SCENE...``: run after run to a table."""

import sys
from dataclasses import dataclass, field
from itertools import pairwise
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal, get_args

import tyro

from ringlight.cli.arguments import MaybeFolder, Net
from ringlight.cli.flags import flags_in
from ringlight.cli.main import WRONG_INPUT
from ringlight.cli.many_runs import check_jobs, expected_time
from ringlight.cli.parse import parse, refuse
from ringlight.cli.run_length import check_length
from ringlight.cli.threads import check_threads
from ringlight.core.words import counted
from ringlight.data.options import SceneOptions
from ringlight.errors import RecipeError

if TYPE_CHECKING:
    from ringlight.methods.variant import Variant
    from ringlight.runs.study import StudyRun

Study = Literal["ablation", "field", "rank", "feature", "gamma", "beta", "warmup", "pareto"]


@dataclass(frozen=True)
class StudyArguments:
    """Repeat a table of the paper: the same method with one thing changed at a time, on scenes and seeds of your
    choice.

    ablation (tables 2 and 3, with controls), field (other decompositions), rank and feature (appendix E), gamma, beta,
    warmup; and pareto: quality over megabytes and over core seconds, beside harmonics of every degree at five sizes and
    five lengths. Each run gets its own folder OUT/SCENE/VARIANT/seed-N. The same command goes on after an interrupt:
    finished runs are kept, and so are those that another study made in OUT; others resume. A run that fails stops no
    other but those that wait for its size. Ends with OUT/STUDY.md, .csv, .json and .png.
    """

    what: Annotated[tyro.conf.Positional[Study], tyro.conf.arg(metavar="STUDY")]
    """ablation, field, rank, feature, gamma, beta, warmup or pareto."""
    scenes: Annotated[
        tyro.conf.Positional[tuple[Path, ...]],
        tyro.conf.arg(metavar="SCENE [SCENE ...]", help_behavior_hint="(required)"),
    ]
    """Folders of photographs with cameras. toaster and carpaint are bundled."""
    options: Annotated[SceneOptions, tyro.conf.arg(name="")] = field(default_factory=SceneOptions)
    base: Literal["ringlight-paper", "ringlight-ring", "ringlight-basis", "ringlight-mirror"] | None = None
    """What the variants change: by default the paper's settings. What pareto holds against 3dgs: by default
    ringlight-basis."""
    steps: int | None = None
    """Training steps of each run, for pareto of the longest; by default the method's own, 30000 of most."""
    seeds: int = 2
    """Runs of each variant, with seeds 0, 1, .... The table shows mean and standard deviation."""
    out: MaybeFolder = None
    """Folder of the study; by default runs/study-BASE."""
    only: tuple[str, ...] = ()
    """Variants to run and show, by name; --dry-run lists them."""
    lpips: tuple[Net, ...] = ("alex",)
    """Networks of LPIPS; the flag without a name measures none. 'ringlight fetch-lpips' gets their weights."""
    jobs: int = 1
    """Runs side by side on this machine, each a process."""
    threads: int = 0
    """Threads of each run; 0 shares the cores out among the jobs, or takes those of a cluster's worker."""
    scheduler: Annotated[str | None, tyro.conf.arg(metavar="tcp://HOST:PORT")] = None
    """Do the runs on the workers of this Dask scheduler (extra [cluster]); OUT and scenes are on a disk that all
    share."""
    dry_run: bool = False
    """List the runs, which of them are finished, and about how long the others take. Nothing is run."""
    json: bool = False
    """Print the result as JSON instead of the table."""
    quiet: bool = False
    """No progress; what fails is said all the same."""


def main(arguments: list[str]) -> int:
    """Run what is missing, then show; returns the exit code, 1 where runs are missing in the end."""
    named = arguments[0] if arguments and arguments[0] in get_args(Study) else ""
    if any("," in word for flag, word in pairwise(arguments) if flag == "--seeds"):
        refuse("study", "--seeds is how many there are, as 2 for the seeds 0 and 1")
    asked = parse(StudyArguments, "study", arguments, before=named)
    if not asked.scenes:
        refuse("study", "no scene is named; give folders of photographs, or toaster or carpaint")
    if "--only" in flags_in(arguments) and not asked.only:
        refuse("study", "--only names no variant; name some, --dry-run lists them")
    if asked.seeds is not None and asked.seeds < 1:
        raise RecipeError(f"--seeds is {asked.seeds}; give at least 1")
    if asked.steps is not None:
        check_length(asked.steps)
    check_jobs(asked.jobs, asked.scheduler, arguments)
    check_threads(asked.threads, 0 if asked.scheduler else asked.jobs)
    from ringlight.methods.studies import base_of, study_named

    variants = _chosen(asked, study_named(asked.what, asked.base, asked.steps))
    from ringlight.measure.json_record import to_json
    from ringlight.runs.expected_time import core_seconds
    from ringlight.runs.folder import make_folder, refuse_file_in_the_way
    from ringlight.runs.study import runs_of_study

    out = asked.out or Path("runs") / f"study-{base_of(asked.what, asked.base)}"
    refuse_file_in_the_way(out)
    runs = runs_of_study(variants, asked.scenes, asked.seeds, out, asked.options)
    if asked.dry_run:
        expected = [run.expected for run in runs]
        if asked.json:
            seconds, told = core_seconds(expected)
            record = {"runs": _listed(runs), "core_seconds": seconds, "estimated_by_own_runs": told}
            sys.stdout.write(to_json(record))
        else:
            sys.stdout.write(_listing(runs, expected_time(expected)))
        return 0
    make_folder(out)
    failed = _run_all(asked, runs)
    if any(run.state == "finished" for run in runs):
        _show(asked, out, variants, runs)
    for name, reason in failed.items():
        sys.stderr.write(f"missing: {name}: {reason}\n")
    return WRONG_INPUT if failed else 0


def _chosen(asked: StudyArguments, variants: "tuple[Variant, ...]") -> "tuple[Variant, ...]":
    names = [variant.name for variant in variants]
    for name in asked.only:
        if name not in names:
            raise RecipeError(f"--only: study {asked.what} has no variant {name!r}; it has {', '.join(names)}")
    return tuple(variant for variant in variants if not asked.only or variant.name in asked.only)


def _listed(runs: "tuple[StudyRun, ...]") -> list[dict[str, object]]:
    return [
        {
            "folder": str(run.folder),
            "state": run.state,
            "scene": str(run.scene),
            "variant": run.variant.name,
            "about": run.variant.about,
            "seed": run.seed,
            "steps": run.variant.recipe.steps,
        }
        for run in runs
    ]


def _listing(runs: "tuple[StudyRun, ...]", about: str) -> str:
    width = max(len(str(run.folder)) for run in runs)
    lines = [f"{run.folder!s:{width}}  {run.state:8}  {run.variant.about}" for run in runs]
    missing = sum(run.state != "finished" for run in runs)
    steps = sorted({run.variant.recipe.steps for run in runs})
    spoken = counted(steps[0], "step") if len(steps) == 1 else f"{steps[0]:,} to {steps[-1]:,} steps"
    return (
        "\n".join([*lines, f"{counted(len(runs), 'run')} of {spoken}, {missing} to do{about and ': ' + about}"]) + "\n"
    )


def _run_all(asked: StudyArguments, runs: "tuple[StudyRun, ...]") -> dict[str, str]:
    """Do what is missing; returns why runs failed."""
    from ringlight.cli.many_runs import Doing, do_runs

    missing = [run for run in runs if run.state != "finished"]
    doing = Doing(asked.jobs, asked.threads, asked.scheduler, asked.quiet)
    threads = doing.threads_each(len(runs))  # those that are done had as many
    return do_runs({run.name: run.order(threads, "auto", asked.lpips) for run in missing}, doing)


def _show(asked: StudyArguments, out: Path, variants: "tuple[Variant, ...]", runs: "tuple[StudyRun, ...]") -> None:
    from ringlight.cli.console import Screen
    from ringlight.methods.studies import base_of
    from ringlight.runs.study_results import study_table, write_results

    table = study_table(variants, runs)
    written = write_results(out, asked.what, base_of(asked.what, asked.base), runs, table)
    if asked.json:
        sys.stdout.write((out / f"{asked.what}.json").read_text(encoding="utf-8"))
    else:
        Screen().print(table)
    if not asked.quiet:
        sys.stderr.write(f"written to {', '.join(map(str, written))}\n")
