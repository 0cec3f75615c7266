"""``ringlight table SCENE... --methods A,B --seeds 0,1``: methods over scenes, side by side or on a cluster."""

import sys
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, get_args

import tyro

from ringlight.cli.arguments import Device, MaybeFolder, Net
from ringlight.cli.main import WRONG_INPUT
from ringlight.cli.many_runs import check_jobs, expected_time
from ringlight.cli.parse import parse, refuse
from ringlight.cli.run_length import check_length
from ringlight.cli.threads import check_threads
from ringlight.core.words import counted
from ringlight.data.options import SceneOptions
from ringlight.errors import RecipeError

if TYPE_CHECKING:
    from ringlight.measure.report import Report
    from ringlight.runs.method_runs import Key, Surveyed


@dataclass(frozen=True)
class TableArguments:
    """Train and measure methods on scenes, and write one table a measure.

    Each run gets its own folder OUT/SCENE/METHOD/seed-SEED, as 'ringlight train' makes it. The same command goes on
    after an interrupt: finished runs are kept, others resume. A run that fails stops no other, nor does a method or a
    scene that there is none of; the table says what is missing and why. Ends with OUT/table.md, .tex, .csv, .json and
    .png.
    """

    scenes: Annotated[
        tyro.conf.Positional[tuple[Path, ...]],
        tyro.conf.arg(metavar="SCENE [SCENE ...]", help_behavior_hint="(required)"),
    ]
    """Folders of photographs with cameras. toaster and carpaint are bundled."""
    methods: Annotated[str, tyro.conf.arg(metavar="A,B,...")]
    """Methods, with commas between. NAME=METHOD calls a column so, for the same method with other settings."""
    seeds: Annotated[str, tyro.conf.arg(metavar="0,1,...")] = "0"
    """Seeds of each pair, with commas between."""
    steps: int | None = None
    """Training steps of each run; by default the method's own, 30000 of most."""
    set: Annotated[tuple[str, ...], tyro.conf.arg(metavar="METHOD.key=value")] = ()
    """Settings of one method, as 3dgs.densify.threshold=1e-4; by default its own."""
    options: Annotated[SceneOptions, tyro.conf.arg(name="")] = field(default_factory=SceneOptions)
    out: MaybeFolder = None
    """Folder of the table and its runs; by default runs/table."""
    jobs: int = 1
    """Runs side by side on this machine, each a process."""
    threads: int = 0
    """Threads of each run; 0 shares the cores out among the jobs, or takes those of a cluster's worker."""
    scheduler: Annotated[str | None, tyro.conf.arg(metavar="tcp://HOST:PORT")] = None
    """Do the runs on the workers of this Dask scheduler (extra [cluster]); OUT and scenes are on a disk that all
    share."""
    device: Device = "auto"
    """Rasterizer."""
    lpips: tuple[Net, ...] = ("alex",)
    """Networks of LPIPS; the flag without a name measures none. 'ringlight fetch-lpips' gets their weights."""
    dry_run: bool = False
    """List the runs, which of them are finished, and about how long the others take. Nothing is run."""
    json: bool = False
    """Print the result as JSON instead of the tables."""
    quiet: bool = False
    """No progress; what fails is said all the same."""


def main(arguments: list[str]) -> int:
    """Run what is missing, then show; returns the exit code, 1 where runs are missing in the end."""
    asked = parse(TableArguments, "table", arguments)
    if not asked.scenes:
        refuse("table", "no scene is named; give folders of photographs, or toaster or carpaint")
    seeds = _seeds(asked.seeds)
    check_jobs(asked.jobs, asked.scheduler, arguments)
    if asked.steps is not None:
        check_length(asked.steps)
    check_threads(asked.threads, 0 if asked.scheduler else asked.jobs)
    if asked.options.holdout_every == 0 and asked.options.holdout is None and not asked.options.validate:
        raise RecipeError("a table compares on test views, and --holdout-every 0 leaves none; leave it out")
    from ringlight.runs.folder import make_folder, refuse_file_in_the_way
    from ringlight.runs.left_out import asked_for
    from ringlight.runs.method_runs import methods_named, plan

    names = [word.strip() for word in asked.methods.split(",") if word.strip()]
    if not names:
        refuse("table", "--methods names none; give some with commas between, as 3dgs,ringlight")
    there = asked_for(asked.scenes, names, asked.set)
    methods = methods_named(there.methods, there.settings, asked.steps)
    out = asked.out or Path("runs") / "table"
    refuse_file_in_the_way(out)
    runs = plan(there.scenes, methods, seeds, out, asked.options)
    for reason in (*there.columns_left_out.values(), *there.rows_left_out.values()):
        sys.stderr.write(f"warning: left out: {reason}\n")
    if asked.dry_run:
        _list(asked, runs, there.reasons(seeds))
        return 0
    make_folder(out)
    failed = there.reasons(seeds) | _run(asked, runs)
    return _show(asked, out, runs, seeds, failed)


def _seeds(text: str) -> tuple[int, ...]:
    from ringlight.runs.record import LARGEST_SEED

    try:
        seeds = tuple(int(word) for word in text.split(","))
    except ValueError:
        raise RecipeError(f"--seeds is {text!r}; give whole numbers with commas between, as 0,1") from None
    if len(set(seeds)) < len(seeds) or not all(0 <= seed <= LARGEST_SEED for seed in seeds):
        raise RecipeError(f"--seeds is {text!r}; give different whole numbers from 0 to {LARGEST_SEED}")
    return seeds


def _name(key: "Key") -> str:
    scene, method, seed = key
    return f"{scene}/{method}/seed-{seed}"


def _list(asked: TableArguments, runs: "dict[Key, Surveyed]", left_out: "dict[Key, str]") -> None:
    from ringlight.measure.json_record import to_json
    from ringlight.runs.expected_time import core_seconds
    from ringlight.runs.method_runs import expected

    if asked.json:
        seconds, told = core_seconds(expected(runs))
        listed = [
            {
                "scene": key[0],
                "method": key[1],
                "seed": key[2],
                "folder": str(surveyed.run.folder),
                "state": surveyed.state or "refused",
                "reason": surveyed.reason,
                "steps": surveyed.run.recipe.steps,
            }
            for key, surveyed in runs.items()
        ]
        gone = [{"scene": key[0], "method": key[1], "seed": key[2], "reason": why} for key, why in left_out.items()]
        told_of = {"runs": listed, "left_out": gone, "core_seconds": seconds, "estimated_by_own_runs": told}
        sys.stdout.write(to_json(told_of))
        return
    width = max(len(str(surveyed.run.folder)) for surveyed in runs.values())
    for surveyed in runs.values():
        state = surveyed.state or f"refused: {surveyed.reason}"
        sys.stdout.write(f"{surveyed.run.folder!s:{width}}  {surveyed.run.recipe.steps:>6} steps  {state}\n")
    missing = sum(surveyed.state in ("to do", "started") for surveyed in runs.values())
    about = expected_time(expected(runs))
    sys.stdout.write(f"{counted(len(runs), 'run')}, {missing} to do{about and ': ' + about}\n")


def _run(asked: TableArguments, runs: "dict[Key, Surveyed]") -> "dict[Key, str]":
    """Do what is missing; returns why runs failed."""
    from ringlight.cli.many_runs import Doing, do_runs
    from ringlight.runs.method_runs import order_of

    missing = {_name(key): key for key, surveyed in runs.items() if surveyed.state in ("to do", "started")}
    doing = Doing(asked.jobs, asked.threads, asked.scheduler, asked.quiet)
    threads = doing.threads_each(len(runs))  # those that are done had as many
    _tell_of_kept(asked, [surveyed for surveyed in runs.values() if surveyed.state == "finished"])
    orders = {name: order_of(runs[key].run, threads, asked.device, asked.lpips) for name, key in missing.items()}
    return {missing[name]: reason for name, reason in do_runs(orders, doing).items()}


def _tell_of_kept(asked: TableArguments, finished: "list[Surveyed]") -> None:
    """Say which flags would have made finished runs otherwise: they are kept as they are."""
    for flag in () if asked.quiet else ("device", "lpips"):
        others = sum(_was_made_otherwise(flag, asked, run.run.folder, run.report) for run in finished if run.report)
        if others:
            kept = counted(others, "finished run")
            sys.stderr.write(f"--{flag} changes nothing of {kept}; give another --out for that\n")


def _was_made_otherwise(flag: str, asked: TableArguments, folder: Path, report: "Report") -> bool:
    from ringlight.runs.record import RunRecord

    if getattr(asked, flag) == getattr(TableArguments, flag):
        return False
    if flag == "device":
        return RunRecord.read(folder).device != asked.device
    measured = {net for net in get_args(Net) if getattr(report, f"lpips_{net}") is not None}
    return not report.lpips_note and measured != set(asked.lpips)  # a note says why one is lacking


def _show(
    asked: TableArguments, out: Path, runs: "dict[Key, Surveyed]", seeds: tuple[int, ...], failed: "dict[Key, str]"
) -> int:
    from ringlight.cli.console import Screen
    from ringlight.measure.json_record import to_json
    from ringlight.runs.method_results import holds_runs, method_table, record_of, write_table

    table = method_table(runs, seeds, failed)
    steps = sorted({surveyed.run.recipe.steps for surveyed in runs.values()})
    title = counted(steps[0], "step") if len(steps) == 1 else f"{steps[0]:,} to {steps[-1]:,} steps"
    there = sum(len(by_seed) for by_seed in table.cells.reports.values())
    keeps = not there and holds_runs(out)
    written = () if keeps else write_table(out, table, runs, title)
    if asked.json:
        sys.stdout.write(to_json(record_of(table, runs)))
    else:
        Screen().print(table)
    if keeps:
        sys.stderr.write(f"the earlier table in {out} is kept, for none of these runs is there\n")
    elif not asked.quiet:
        sys.stderr.write(f"written to {', '.join(map(str, written))}\n")
    return 0 if there == len(runs) and not failed else WRONG_INPUT
