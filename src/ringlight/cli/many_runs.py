"""What commands of many runs have in common: where these are done, how they are watched, what a signal does."""

import sys
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

from ringlight.cli.flags import flags_in
from ringlight.cli.main import Stopped
from ringlight.cli.signals import kept_signals
from ringlight.cli.streams import past_bars
from ringlight.cli.threads import MOST_THREADS
from ringlight.core.cores import usable_cores
from ringlight.core.words import counted
from ringlight.errors import BackendError, RecipeError

if TYPE_CHECKING:
    from ringlight.runs.expected_time import Expected
    from ringlight.runs.many import Order, Place


@dataclass(frozen=True)
class Doing:
    """How runs are done: ``jobs`` side by side on this machine, or on the workers of the Dask ``scheduler``."""

    jobs: int
    threads: int
    scheduler: str | None
    quiet: bool

    def threads_each(self, runs: int) -> int:
        """Threads of each of so many: the cores are shared out unless somebody says otherwise; 0 takes a worker's."""
        if self.threads or self.scheduler is not None or not runs:
            return self.threads
        return min(max(1, usable_cores() // min(self.jobs, runs)), MOST_THREADS)

    def place(self) -> "Place":
        """Where they are done. Raises BackendError for a scheduler that does not answer, or without Dask."""
        if self.scheduler is None:
            from ringlight.runs.side_by_side import SideBySide

            return SideBySide(self.jobs)
        from ringlight.runs.cluster import Cluster

        return Cluster(self.scheduler)


def expected_time(runs: "Sequence[Expected]") -> str:
    """As "about 12 min of one core", with what tells it; empty where nothing is missing."""
    from ringlight.cli.progress import spoken
    from ringlight.runs.expected_time import core_seconds

    seconds, told = core_seconds(runs)
    source = "by the finished runs" if told else "by the README's runs; finished ones tell better"
    return f"about {spoken(seconds)} of one core ({source})" if seconds else ""


def check_jobs(jobs: int, scheduler: str | None, arguments: list[str]) -> None:
    """Raises RecipeError for fewer than one, and where they are among the ``arguments`` with a scheduler."""
    if scheduler is not None and "--jobs" in flags_in(arguments):
        raise RecipeError("--jobs is of this machine, and each worker of --scheduler does one run; leave it out")
    if jobs < 1:
        raise RecipeError(f"--jobs is {jobs}; give at least 1")


def do_runs(orders: "Mapping[str, Order]", doing: Doing) -> dict[str, str]:
    """Do the runs, by name; returns why some failed, or all where a scheduler does not answer. Raises Stopped where a
    signal ended it; what is saved then is said."""
    from ringlight.cli.many_progress import showing
    from ringlight.runs.many import run_many

    if not orders:
        return {}
    try:
        place = doing.place()
    except BackendError as error:
        sys.stderr.write(f"ringlight: {error}\n")
        return dict.fromkeys(orders, str(error))
    with showing(list(orders), doing.quiet) as hear, kept_signals(_tell_of_stop) as signals:
        failed = run_many(orders, place, hear, lambda: len(signals))
    if signals:
        sys.stderr.write(f"{_how_it_stopped(len(signals), failed, doing)}; the same command goes on\n")
        raise Stopped(signals[0])
    return failed


def _how_it_stopped(signals: int, failed: Mapping[str, str], doing: Doing) -> str:
    """What is left of the runs; those that ``failed`` were told one by one."""
    if signals > 1:
        return "stopped at once, runs that were under way have their last checkpoints"
    if doing.scheduler is not None:
        return "stopped, its runs end their step on the workers and save"
    if failed:
        return f"stopped, {counted(len(failed), 'run')} failed as told above, nothing else is lost"
    return "stopped, nothing is lost"


def _tell_of_stop(number: int, before: list[int]) -> None:
    if not before:
        past_bars(sys.stderr).write("\nall runs finish their step, then save; press Ctrl-C again to stop at once\n")
