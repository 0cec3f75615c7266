"""Runs that are killed with SIGKILL at random moments of training and saving, and resumed to the end: the same files?

    python tests/unplugging.py --kills 200                     what ``make unplug`` runs

Each run is killed once, or twice where a coin says so, and then goes on to its end, with one thread or two. Torch is
imported once; every run is a fork of this process, which starts no threads of its own.
"""

import argparse
import faulthandler
import json
import os
import pkgutil
import random
import shutil
import signal
import sys
import tempfile
import time
import traceback
from dataclasses import asdict, dataclass, field
from importlib import import_module
from pathlib import Path

sys.path.append(str(Path(__file__).parent / "cli"))
# Threads of libraries would not survive the forks.
os.environ["OMP_NUM_THREADS"] = os.environ["OPENBLAS_NUM_THREADS"] = os.environ["MKL_NUM_THREADS"] = "1"

from cli_session import QUICK, SMALL_LIGHT, flags
from scenes_on_disk import write_tiny_scene

import ringlight
from long_record import write_record
from ringlight.files.atomic import BEGUN, HALF_DONE
from ringlight.files.tensor_file import read_tensors
from ringlight.runs.folder import FRESH_NAME, RunFolder
from ringlight.runs.verify import digest_of

SAVING = ("--save-every", "0.00001")
"""A checkpoint after every step: most moments of such a run are moments of saving."""

LEAN = ("--quiet", "--lpips")

VOLUME = (*flags(steps=40, first_side=10, last_side=16, rays=64), *LEAN)
"""Its grid is refined five times, empty space found twice, and rays are left out."""

TRAINS = (*flags(steps=40, coarsest=8, finest=32, density_rank=8, appearance_rank=10, rays=64), *LEAN)
"""They double twice, and empty space is found twice."""

WORDS: dict[str, tuple[str, ...]] = {
    "3dgs": (*QUICK, *SAVING),
    "ringlight-ring": (*QUICK, *SAVING, *SMALL_LIGHT),
    "tensorf": (*VOLUME, *SAVING),
    "putt": (*TRAINS, *SAVING),
}

TIMED = {"fps", "fps_note", "train_seconds", "train_cpu_seconds", "saving_seconds", "steps_per_second"}
TIMED |= {"choosing_cpu_seconds", "peak_bytes", "training_bytes", "machine", "curve"}
"""Fields of a report that differ from one run to the next; ``machine`` has the number of threads."""

EARLY = 1e-4
"""Chance, asked every two milliseconds, that a run is killed before it has a checkpoint."""

PATIENCE = 300
"""Seconds for one run, a hundred times what it takes."""


@dataclass
class Tally:
    """What happened: kills by where they hit, and what differed."""

    while_training: int = 0
    while_saving: int = 0
    before_the_first_checkpoint: int = 0
    different: list[str] = field(default_factory=list)

    @property
    def kills(self) -> int:
        """All of them."""
        return self.while_training + self.while_saving + self.before_the_first_checkpoint


def start(words: list[str], log: Path) -> int:
    """``ringlight train`` with these words, in a process of its own."""
    process = os.fork()
    if process:
        return process
    code = 70
    try:
        output = os.open(log, os.O_WRONLY | os.O_CREAT | os.O_APPEND)
        os.dup2(output, 1)
        os.dup2(output, 2)
        # Those of the parent may know a file, where this is a pipe; these last as long as the process.
        sys.stdout, sys.stderr = (open(number, "w", buffering=1, closefd=False) for number in (1, 2))  # noqa: SIM115
        from ringlight.cli.main import main

        faulthandler.enable(output)  # where it crashes
        faulthandler.dump_traceback_later(PATIENCE - 10, exit=True, file=output)  # where it hangs
        main(["train", *words])
    except SystemExit as end:
        code = int(end.code or 0)
    except BaseException:
        traceback.print_exc()
    finally:
        os._exit(code)


def finish(process: int) -> int:
    """The exit code; a process that hangs is killed, which is no code of ours."""
    end = time.monotonic() + PATIENCE
    while time.monotonic() < end:
        done, status = os.waitpid(process, os.WNOHANG)
        if done:
            return os.waitstatus_to_exitcode(status)
        time.sleep(0.005)
    os.kill(process, signal.SIGKILL)
    return os.waitstatus_to_exitcode(os.waitpid(process, 0)[1])


def kill_after(process: int, run: Path, seconds: float, draw: random.Random) -> int | None:
    """None where it was still alive then, else how it had ended by itself; nearly always the time counts from the first
    checkpoint."""
    end = time.monotonic() + PATIENCE
    waits_for_checkpoint, deadline = True, end
    while time.monotonic() < deadline:
        done, status = os.waitpid(process, os.WNOHANG)
        if done:  # it may have crashed before there was a checkpoint: nothing would come
            return os.waitstatus_to_exitcode(status)
        if waits_for_checkpoint and (draw.random() < EARLY or RunFolder(run).checkpoints):
            waits_for_checkpoint, deadline = False, time.monotonic() + seconds
        time.sleep(min(0.002, max(deadline - time.monotonic(), 0)))
    os.kill(process, signal.SIGKILL)
    os.waitpid(process, 0)
    return None


def results(run: Path) -> dict[str, object]:
    """Everything that a run leaves, without times."""
    report = json.loads((run / "report.json").read_text())
    found: dict[str, object] = {
        "report.json": {name: value for name, value in report.items() if name not in TIMED},
        "checkpoint": digest_of(read_tensors(RunFolder(run).checkpoint).tensors),
    }
    for path in [run / "model.safetensors", run / "recipe.json", *sorted((run / "images").rglob("*.png"))]:
        found[str(path.relative_to(run))] = path.read_bytes()
    return found


def count_kill(run: Path, tally: Tally) -> None:
    """Where the kill hit, as seen from what lies there."""
    if not RunFolder(run).checkpoints:
        tally.before_the_first_checkpoint += 1
    elif list(run.glob(f"{BEGUN}*{HALF_DONE}")) or (run / FRESH_NAME).exists():
        tally.while_saving += 1
    else:
        tally.while_training += 1


def _end_of(log: Path) -> str:
    """What a process that failed has said, with its stack if it crashed or hung."""
    return log.read_text(errors="replace")[-3000:]


def unplugged(run: Path, words: list[str], length: float, draw: random.Random, tally: Tally) -> int:
    """One run, killed once or twice and resumed; the exit code of its last process."""
    threads = ["--threads", str(draw.choice([1, 2]))]
    log = run.with_suffix(".log")
    command = [*words, "--out", str(run), *threads]
    for _ in range(draw.choice([1, 2])):
        code = kill_after(start(command, log), run, draw.random() * length, draw)
        if code is None:
            count_kill(run, tally)
        elif code != 0:
            tally.different.append(f"{run.name} ended by itself with {code}: {_end_of(log)}")
        if RunFolder(run).checkpoints:
            command = ["--resume", str(run), *threads, "--quiet", "--lpips", *SAVING]
        else:  # nothing to resume: the user starts again, in another folder
            shutil.rmtree(run, ignore_errors=True)
        if code is not None:
            break
    return finish(start(command, log))


def main() -> int:
    """Exit code 1 where any file of any run differs from those of a run that was left alone."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--kills", type=int, default=200)
    parser.add_argument("--methods", nargs="+", default=list(WORDS), choices=list(WORDS))
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--record", type=Path, help="JSON file to write")
    asked = parser.parse_args()
    import_everything()
    draw, tally = random.Random(asked.seed), Tally()
    with tempfile.TemporaryDirectory(prefix="ringlight-unplug-") as home:
        scene = write_tiny_scene(Path(home) / "balls")
        alone, length = {}, {}
        for method in asked.methods:
            words = [str(scene), method, *WORDS[method]]
            log = Path(home) / "log"
            process = start([*words, "--out", f"{home}/{method}"], log)
            _wait_for(RunFolder(Path(home) / method).checkpoint, log)
            begun = time.monotonic()
            _wait_for(Path(home) / method / "images", log)  # which is made when the training has ended
            length[method] = time.monotonic() - begun
            assert finish(process) == 0, "the run left alone"
            alone[method] = results(Path(home) / method)
        number = 0
        while tally.kills < asked.kills:
            number += 1
            method, run = draw.choice(list(alone)), Path(home) / f"run-{number}"
            words = [str(scene), method, *WORDS[method]]
            code = unplugged(run, words, length[method], draw, tally)
            if code != 0:
                tally.different.append(f"{run.name} ended with {code}: {_end_of(run.with_suffix('.log'))}")
            else:
                found = results(run)
                names = [
                    name for name in alone[method].keys() | found.keys() if alone[method].get(name) != found.get(name)
                ]
                tally.different += [f"run {number} ({method}): {name}" for name in sorted(names)]
            shutil.rmtree(run, ignore_errors=True)
    print(  # noqa: T201
        f"{tally.kills} kills in {number} runs: {tally.while_saving} with a file half written, {tally.while_training} "
        f"between, {tally.before_the_first_checkpoint} before the first checkpoint; {len(tally.different)} differences",
        *tally.different,
        sep="\n",
    )
    if asked.record:
        command = " ".join(["python", *sys.argv])
        write_record(asked.record, command=command, kills=tally.kills, runs=number, **asdict(tally))
    return int(bool(tally.different))


def import_everything() -> None:
    """Once for all processes. Nothing is run here: threads that a run starts do not survive a fork."""
    for module in ("scipy.spatial", "torch.fx.experimental.symbolic_shapes", "tyro"):
        import_module(module)
    for module in pkgutil.walk_packages(ringlight.__path__, "ringlight."):
        if module.name != "ringlight.__main__":
            try:
                import_module(module.name)
            except ModuleNotFoundError as error:  # what only some machines have
                if str(error.name).startswith("ringlight"):
                    raise
    import torch

    torch.set_num_threads(1)


def _wait_for(path: Path, log: Path) -> None:
    end = time.monotonic() + PATIENCE
    while not path.exists():
        assert time.monotonic() < end, f"{path} does not appear: {log.read_text()}"
        time.sleep(0.002)


if __name__ == "__main__":
    sys.exit(main())
