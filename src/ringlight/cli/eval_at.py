"""``--eval-at STEP``: the test views, measured while a run trains. It only looks: what cannot be measured costs no
step."""

from collections.abc import Callable, Sequence

from ringlight.errors import RinglightError
from ringlight.runs.finish import psnr_of_views
from ringlight.runs.session import Session
from ringlight.runs.watch import Watch

Tell = Callable[[str], None]


def warn_of_steps_done(asked: Sequence[int], session: Session, warn: Tell) -> None:
    """Before the first step of a run that goes on."""
    done = [str(step) for step in asked if step <= session.training.step]
    if done:
        warn(f"--eval-at {' '.join(done)} has no effect: the run goes on after step {session.training.step}")


def measure_test_views(session: Session, watch: Watch, say: Tell, warn: Tell) -> None:
    """As they are after the step at hand; ``watch`` keeps the number."""
    step = session.training.step
    if not session.scene.test:
        say(f"step {step}: there are no test views to measure on")
        return
    try:
        decibels = psnr_of_views(session.training.model, session.scene)
    except (RinglightError, OSError) as error:
        warn(f"step {step}: the test views cannot be measured: {error}")
        return
    watch.tell_test(step, decibels)
    say(f"step {step}: {decibels:.2f} dB on the test views")
