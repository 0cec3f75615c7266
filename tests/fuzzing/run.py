"""Mutated files for every loader: no crash, no hang, no memory. For ``make fuzz`` and tests/test_fuzz_loaders.py.

    python tests/fuzzing/run.py --count 10000                  plain mutation, every loader
    python tests/fuzzing/run.py --count 1000000 --guided       coverage-guided, where atheris is installed

A file that is neither read nor refused in a sentence is kept under build/fuzz/found and named. Plain mutation is guided
by outcomes: a file that gets a new sentence becomes a seed. The corpus is kept under build/fuzz/corpus.
"""

import argparse
import faulthandler
import hashlib
import random
import re
import resource
import signal
import subprocess
import sys
import time
import warnings
from pathlib import Path

from mutation import mutated

# Whose scenes and reports are the seeds.
sys.path += [str(Path(__file__).parents[1] / folder) for folder in ("data", "measure")]

SECONDS = 2
"""Of CPU for one file; machines under load are slow in other seconds."""

MEGABYTES = 64
"""Growth of the peak while one file is read: seeds have kilobytes, and this is what libraries load at first use."""

BATCH = 200
"""Files between two looks at the memory."""

MOST_SEEDS = 400


class Hang(BaseException):
    """A file took longer than SECONDS."""


class Runner:
    """One loader and what was found of it."""

    def __init__(self, name: str, home: Path):
        from targets import REFUSALS, TARGETS

        self.name, self.home, self.refusals = name, home, REFUSALS
        self.target = TARGETS[name]()
        self.seeds = list(self.target.seeds)
        self.sentences: dict[str, int] = {}
        self.found: list[str] = []
        self.slowest = 0.0
        for path in sorted((home / "corpus" / name).glob("*")):
            content = path.read_bytes()
            self.seeds.append((content[0] % 256, content[1:]))

    def one(self, kind: int, content: bytes) -> str:
        """What became of it; the shape of the sentence where it was refused."""
        signal.setitimer(signal.ITIMER_PROF, SECONDS)
        begun = time.process_time()
        try:
            self.target.load(kind, content)
            outcome = "read"
        except self.refusals as error:
            text = str(error)
            assert "\n" not in text, f"a sentence of several lines: {text!r}"
            outcome = re.sub(r"'[^']*'|\"[^\"]*\"|\S*/\S*|[-\d.e+]*\d[-\d.e+]*", "#", text)[:160]
        finally:
            signal.setitimer(signal.ITIMER_PROF, 0)
        self.slowest = max(self.slowest, time.process_time() - begun)
        return outcome

    def watched(self, kind: int, content: bytes) -> str:
        """As :meth:`one`; what it must not raise is kept with the file."""
        try:
            return self.one(kind, content)
        except (Exception, Hang, MemoryError) as error:
            what = f"{type(error).__name__}: {error}"[:200]
            self.keep("found", kind, content)
            self.found.append(what)
            return f"found {type(error).__name__}"

    def keep(self, where: str, kind: int, content: bytes) -> None:
        folder = self.home / where / self.name
        folder.mkdir(parents=True, exist_ok=True)
        (folder / hashlib.sha256(content).hexdigest()[:12]).write_bytes(bytes([kind]) + content)

    def run(self, count: int, seed: int, seconds: float) -> int:
        """Plain mutation, guided by outcomes; returns how many files were read."""
        draw = random.Random(f"{self.name}/{seed}")
        for kind, content in self.target.seeds:
            assert self.one(kind, content) == "read", "a seed must be legal"
        end = time.monotonic() + seconds
        for number in range(count):
            if number % BATCH == 0:
                faulthandler.dump_traceback_later(120, exit=True)  # what no signal interrupts
                before = _peak()
            kind, content = draw.choice(self.seeds)
            alike = [other for other_kind, other in self.seeds if other_kind == kind]
            damaged = mutated(content, alike, draw)
            outcome = self.watched(kind, damaged)
            if outcome not in self.sentences and len(self.seeds) < MOST_SEEDS and len(damaged) < 20_000:
                self.seeds.append((kind, damaged))
                self.keep("corpus", kind, damaged)
            self.sentences[outcome] = self.sentences.get(outcome, 0) + 1
            if number % BATCH == BATCH - 1 and number > BATCH and _peak() - before > MEGABYTES:
                self.found.append(f"the peak grew by {_peak() - before:.0f} MB within {BATCH} files before {number}")
            if time.monotonic() > end:
                return number + 1
        return count


def _peak() -> float:
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1000


def _hang(number: int, frame: object) -> None:
    raise Hang(f"over {SECONDS} s of CPU")


def _has_atheris() -> bool:
    try:
        import atheris  # noqa: F401
    except ImportError:
        return False
    return True


def guided(name: str, home: Path, count: int, seconds: float) -> None:
    """Coverage-guided; atheris ends the process."""
    import atheris

    with atheris.instrument_imports(
        include=["ringlight.data", "ringlight.files", "ringlight.runs", "ringlight.methods"]
    ):
        runner = Runner(name, home)
    kinds = max(kind for kind, _ in runner.target.seeds) + 1
    corpus = home / "corpus" / name
    corpus.mkdir(parents=True, exist_ok=True)
    for kind, content in runner.target.seeds:
        (corpus / hashlib.sha256(content).hexdigest()[:12]).write_bytes(bytes([kind]) + content)
    atheris.Setup(
        [sys.argv[0], f"-runs={count}", f"-max_total_time={seconds:.0f}", "-max_len=16384", "-rss_limit_mb=4096",
         "-timeout=20", f"-artifact_prefix={home}/found-{name}-", "-print_final_stats=1", str(corpus)],
        lambda data: runner.one(data[0] % kinds, data[1:]) if data else None,
    )  # fmt: skip
    atheris.Fuzz()


def main() -> int:
    """Exit code 1 where anything was found."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("names", nargs="*", help="loaders; by default all")
    parser.add_argument("--count", type=int, default=10_000, help="files for each loader")
    parser.add_argument("--seconds", type=float, default=3600, help="at most so long for each loader")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--home", type=Path, default=Path("build/fuzz"))
    parser.add_argument("--guided", action="store_true", help="by atheris, which must be installed")
    asked = parser.parse_args()
    warnings.simplefilter("ignore")
    signal.signal(signal.SIGPROF, _hang)
    if asked.guided and not _has_atheris():
        parser.error("atheris is not installed: leave out --guided, or install it")
    if asked.guided and len(asked.names) == 1:
        guided(asked.names[0], asked.home, asked.count, asked.seconds)
    from targets import TARGETS

    bad = 0
    for name in asked.names or TARGETS:
        if asked.guided:  # one process each: the fuzzer ends its own
            words = [sys.executable, __file__, name, "--guided", "--count", str(asked.count), "--home", str(asked.home)]
            bad += subprocess.run([*words, "--seconds", str(asked.seconds)], check=False).returncode != 0
            continue
        runner = Runner(name, asked.home)
        begun = time.process_time()
        done = runner.run(asked.count, asked.seed, asked.seconds)
        read = runner.sentences.get("read", 0)
        print(  # noqa: T201
            f"{name:13} {done:8} files, {read} read, {len(runner.sentences)} outcomes, {len(runner.found)} found, "
            f"slowest {runner.slowest:.3f} s, peak {_peak():.0f} MB, {time.process_time() - begun:.0f} s",
            *(f"\n    {what}" for what in sorted(set(runner.found))[:20]),
            flush=True,
        )
        bad += bool(runner.found)
    return int(bad > 0)


if __name__ == "__main__":
    sys.exit(main())
