"""Runs that are ended in every phase by everything that ends runs, and go on: the right exit code, the same files?

    python tests/kill_matrix.py --times 5                     what ``make kills`` runs

A closed pipe must not end a run at all. A run that was ended before it had a folder is started again by the same
command; any other is resumed. Every run is a fork of this process.
"""

import argparse
import os
import random
import shutil
import signal
import sys
import tempfile
import time
from collections import Counter
from pathlib import Path

sys.path.append(str(Path(__file__).parent / "cli"))
# Threads of libraries would not survive the forks.
os.environ["OMP_NUM_THREADS"] = os.environ["OPENBLAS_NUM_THREADS"] = os.environ["MKL_NUM_THREADS"] = "1"

from scenes_on_disk import write_tiny_scene

from long_record import write_record
from ringlight.runs.folder import RunFolder
from ringlight.runs.record import RECORD_NAME
from unplugging import PATIENCE, finish, import_everything, results, start

CAUSES: dict[str, tuple[signal.Signals | None, int]] = {
    "closed pipe": (None, 0),
    "SIGHUP": (signal.SIGHUP, 129),
    "SIGTERM": (signal.SIGTERM, 143),
    "SIGINT": (signal.SIGINT, 130),
    "SIGKILL": (signal.SIGKILL, 137),
}
"""What is sent, None for nothing, and the exit code that a shell sees."""

STEPS = 150
WORDS = ("ringlight", "--steps", str(STEPS), "--lpips")

SAVING: dict[str, tuple[str, ...]] = {
    "trial": (),
    "first minute": (),
    "middle": ("--save-every", "0.05"),
    "evaluation": (),
    "saving": ("--save-every", "0.00001"),
}
"""Phases, and how often runs save that are ended in them: where nothing is said after ten seconds, so not at all."""

SPREAD = dict.fromkeys(SAVING, 0.3) | {"evaluation": 0.05}
"""Seconds over which moments are drawn from where a phase begins; an evaluation takes a tenth of one."""


def has_begun(phase: str, run: Path, said: str) -> bool:
    """Whether the run is in its phase, as seen from what it says and what lies there."""
    folder = RunFolder(run)
    return {
        "trial": "trying" in said,
        "first minute": (run / RECORD_NAME).is_file(),
        "middle": bool(folder.checkpoints),
        "evaluation": folder.model.is_file(),
        "saving": bool(folder.checkpoints),
    }[phase]


def ended(scene: Path, run: Path, phase: str, cause: str, draw: random.Random) -> int:
    """Start a run, end it by ``cause`` in ``phase``, and tell its exit code."""
    ours, theirs = os.pipe()
    os.set_blocking(ours, False)
    process = start([str(scene), *WORDS, *SAVING[phase], "--out", str(run)], Path(f"/dev/fd/{theirs}"))
    os.close(theirs)
    said, moment, end = "", None, time.monotonic() + PATIENCE
    while time.monotonic() < end:
        said += drained(ours)
        now = time.monotonic()
        if moment is None and has_begun(phase, run, said):
            moment = now + SPREAD[phase] * draw.random()
        if moment is not None and now >= moment:
            break
        time.sleep(0.001)
    sent = CAUSES[cause][0]
    if sent is None:
        os.close(ours)
        return finish(process)
    os.kill(process, sent)
    code = finish_reading(process, ours)
    os.close(ours)
    return code


def drained(pipe: int) -> str:
    """What has been said since."""
    try:
        return os.read(pipe, 65536).decode(errors="replace")
    except BlockingIOError:
        return ""


def finish_reading(process: int, pipe: int) -> int:
    """The exit code of a process whose pipe must not fill up."""
    end = time.monotonic() + PATIENCE
    while time.monotonic() < end:
        drained(pipe)
        done, status = os.waitpid(process, os.WNOHANG)
        if done:
            return os.waitstatus_to_exitcode(status)
        time.sleep(0.005)
    return finish(process)


def as_shells_see(code: int) -> int:
    """A process that SIGKILL ended has 128 more than its number; no other signal shall end one."""
    return 128 + signal.SIGKILL if code == -signal.SIGKILL else code


def gone_on(scene: Path, run: Path, phase: str) -> int:
    """Resume the run, or start it again where it had no folder yet; the exit code."""
    begun = (run / RECORD_NAME).is_file()
    words = ["--resume", str(run), "--lpips"] if begun else [str(scene), *WORDS, *SAVING[phase], "--out", str(run)]
    return finish(start([*words, "--quiet"], run.with_suffix(".log")))


def main() -> int:
    """Exit code 1 where a code is wrong, a run is lost, or a file differs from that of a run that was left alone."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--times", type=int, default=5)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--record", type=Path, help="JSON file to write")
    asked = parser.parse_args()
    import_everything()
    from ringlight.cli import stages

    stages.BETWEEN_SECONDS = 0.0
    draw, wrong, codes = random.Random(asked.seed), [], Counter()
    with tempfile.TemporaryDirectory(prefix="ringlight-kills-") as home:
        scene = write_tiny_scene(Path(home) / "balls", views=14)
        alone = Path(home) / "alone"
        assert finish(start([str(scene), *WORDS, "--out", str(alone)], Path(home) / "log")) == 0, "the run left alone"
        expected = results(alone)
        for phase, cause in [(phase, cause) for phase in SAVING for cause in CAUSES for _ in range(asked.times)]:
            run = Path(home) / "run"
            code = as_shells_see(ended(scene, run, phase, cause, draw))
            codes[f"{phase}, {cause}: {code}"] += 1
            # A run whose moment came after its end has ended by itself.
            late = phase == "evaluation" and code == 0
            if code != CAUSES[cause][1] and not late:
                wrong.append(f"{phase}, {cause}: exit code {code}")
            if code != 0 and gone_on(scene, run, phase) != 0:
                wrong.append(f"{phase}, {cause}: lost: {run.with_suffix('.log').read_text()[-1000:]}")
            else:
                found = results(run)
                names = [name for name in expected.keys() | found.keys() if expected.get(name) != found.get(name)]
                wrong += [f"{phase}, {cause}: {name} differs" for name in sorted(names)]
            shutil.rmtree(run, ignore_errors=True)
            print(f"{phase}, {cause}: {code}", file=sys.stderr, flush=True)  # noqa: T201
    print(f"{sum(codes.values())} runs ended; {len(wrong)} wrong", *wrong, sep="\n")  # noqa: T201
    if asked.record:
        command = " ".join(["python", *sys.argv])
        write_record(asked.record, command=command, runs=sum(codes.values()), codes=dict(codes), wrong=wrong)
    return int(bool(wrong))


if __name__ == "__main__":
    sys.exit(main())
