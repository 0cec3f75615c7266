"""What the commands that train share: progress, signals that save, numbers at the end."""

import signal
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from typing import TYPE_CHECKING

from ringlight.cli.arguments import Net
from ringlight.cli.main import NO_MEMORY, Stopped, is_out_of_memory
from ringlight.cli.signals import kept_signals, signal_of
from ringlight.cli.streams import past_bars
from ringlight.core.command_line import command
from ringlight.errors import BackendError, DivergedError, RecipeError, RinglightError, RunError

if TYPE_CHECKING:
    from ringlight.measure.report import Report
    from ringlight.runs.session import Session


OWN_HOST, VIEW_PORT = "127.0.0.1", 8080
"""Where the page of a run is, unless somebody says otherwise: for this machine alone."""


@dataclass(frozen=True)
class RunOptions:
    """What is watched and kept while a run trains; none of it changes the numbers."""

    threads: int = 0
    """Threads of the kernels; 0 takes every core. Results do not depend on it."""
    save_every: float | None = None
    """Seconds between two checkpoints. By default 60, or up to 600 if saving would take over 1 % of the time."""
    eval_at: tuple[int, ...] = ()
    """Steps after which the test views are measured during the run."""
    preview: int = 0
    """Every so many steps a picture of the first test view, or training view, into RUN/previews; 0 for none."""
    tensorboard: bool = False
    """Write events for TensorBoard into RUN/tensorboard; needs the [tensorboard] extra."""
    view: bool = False
    """Show the run in a browser while it trains; needs the [view] extra."""
    host: str = OWN_HOST
    """Address at which --view listens. 0.0.0.0 is all of this machine's: whoever reaches it may look, and pause."""
    port: int = VIEW_PORT
    """Port at which --view listens; 0 is any that is free."""
    lpips: tuple[Net, ...] = ("alex",)
    """Networks of LPIPS, measured at the end; the flag without a name measures none. 'ringlight fetch-lpips' gets their
    weights."""
    json: bool = False
    """Print the report as JSON on standard output instead of the table."""
    quiet: bool = False
    """No progress line."""

    def __post_init__(self) -> None:
        if not self.view and (self.host, self.port) != (OWN_HOST, VIEW_PORT):
            flag = "--port" if self.host == OWN_HOST else "--host"
            raise RecipeError(f"{flag} is of the page in a browser; give --view with it")


def check_steps(options: RunOptions, steps: int) -> None:
    """Raises RecipeError where --eval-at or --save-every names what never comes in a run of ``steps``."""
    for step in options.eval_at:
        if not 1 <= step <= steps:
            raise RecipeError(f"--eval-at is {step}; this run has steps 1 to {steps}")
    if options.preview < 0:
        raise RecipeError(f"--preview is {options.preview}; give a number of steps, or 0 for none")
    if options.save_every is not None and not options.save_every > 0:
        raise RecipeError(f"--save-every is {options.save_every:g}; give a number of seconds above zero")


def check_watching(options: RunOptions) -> None:
    """Raises BackendError where events for TensorBoard or a viewer are asked for and the library is not there,
    RunError where the viewer cannot listen."""
    if options.view:
        from ringlight.view.viser_server import check_address, viser_library

        viser_library()
        check_address(options.host, options.port)
    if options.tensorboard:
        from ringlight.runs.events import event_library

        event_library()


def act_at_second(number: int, before: list[int]) -> None:
    """The first signal lets the step under way end; a second one acts at once."""
    if before:
        raise KeyboardInterrupt(number)
    past_bars(sys.stderr).write("\nfinishing this step, then saving; press Ctrl-C again to stop at once\n")


def train_and_measure(
    session: "Session", options: RunOptions, resume_with: str, hear: Callable[[int, list[int]], None] = act_at_second
) -> "Report":
    """Train what remains, save, and measure the test views. Raises Stopped where a signal stopped it, which is saved.

    ``resume_with`` is the command line that goes on from there, or from the last checkpoint after a second signal.
    ``hear`` gets each signal and those before it, as :func:`kept_signals` says; where it never raises, the run is
    saved however many come.
    """
    try:
        return _train_save_measure(session, options, resume_with, hear)
    except KeyboardInterrupt as interruption:
        number = signal_of(interruption)
        if not session.folder.checkpoints:
            sys.stderr.write(f"stopped at once; begin again with: {resume_with}\n")
            raise Stopped(number) from None
        sys.stderr.write(f"stopped at once; go on from the last checkpoint with: {resume_with}\n")
        raise Stopped(number) from None
    except BackendError as error:
        raise BackendError(f"{error}; {session.way_on()}") from error
    except RecipeError as error:  # the same settings would fail again
        raise RecipeError(f"{error}; that is another run: give it --out NEW") from error
    except (MemoryError, RuntimeError) as error:
        # Nothing is saved: the step under way may have moved some of the parameters.
        if not is_out_of_memory(error):
            raise
        raise RunError(f"{NO_MEMORY}; {session.way_on()}") from error
    finally:
        session.lock.release()


def _train_save_measure(
    session: "Session", options: RunOptions, resume_with: str, hear: Callable[[int, list[int]], None]
) -> "Report":
    from ringlight.cli.progress import announce, show_steps
    from ringlight.cli.stages import counting
    from ringlight.runs.finish import measure_session

    announce(session, options.quiet)
    with kept_signals(hear) as stopping:
        try:
            show_steps(session, options, stopping)
        except DivergedError as error:
            with suppress(DivergedError):  # where even a parameter is not finite the checkpoint before it stays
                session.save()
            raise DivergedError(f"{error}; {session.way_on()}") from error
        session.save()
    left = session.training.steps - session.training.step
    if left or stopping:
        way = "go on with" if left else "that was the last, measure it with"
        sys.stderr.write(f"stopped after step {session.training.step} and saved; {way}: {resume_with}\n")
        raise Stopped(next(iter(stopping), signal.SIGINT))
    with _saved_all_the_same(session), counting("measuring views", options.quiet) as tell:
        return measure_session(session, options.lpips, tell)


@contextmanager
def _saved_all_the_same(session: "Session") -> Iterator[None]:
    """What fails inside the block, in which a finished run is measured, says that its model is saved."""
    way = f"the model is saved, measure it with: {command('eval', session.folder.path)}"
    try:
        yield
    except RinglightError as error:
        raise RunError(f"{error}; {way}") from error
    except OSError as error:
        raise RunError(f"{error.filename or 'measuring'}: {error.strerror}; {way}") from error
    except (MemoryError, RuntimeError) as error:
        if not is_out_of_memory(error):
            raise
        raise RunError(f"{NO_MEMORY}; {way}") from error
