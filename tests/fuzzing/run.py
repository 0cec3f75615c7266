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
import signal
import subprocess
import sys
import time
import warnings
from pathlib import Path
from typing import Any

from memory_peak import MemoryPeak
from mutation import mutated

# Whose scenes and reports are the seeds, and the form of the record.
sys.path += [str(Path(__file__).parents[1] / folder) for folder in ("data", "measure", "")]

SECONDS = 2
"""Of CPU for one file; machines under load are slow in other seconds."""

LOADING_SECONDS = 60
"""Of CPU for a legal file that is opened for the first time: torch and the kernels are loaded by that, which has taken
more than two seconds on a slow machine."""

TIMES_LEGAL = 4
"""A damaged file may take so many times the memory of the legal file that it was made from."""

LEAST_LEGAL = 1 << 20
"""Bytes: what a legal file counts at least. Allocators and the system's counters know no less than parts of this."""

SLACK = 1 << 18
"""Bytes: a peak that grew by less counts on from where it began."""

LARGE_EVERY = 1000
"""One file of so many is made from a large seed, where the loader has one; these are a hundred times slower."""

WATCHDOG = 600
"""Seconds for BATCH files, a thousand times what they take, before the process ends itself and says where it was."""

BATCH = 200
"""Files between two words to the watchdog."""

LEGAL_SHARE = 0.5
"""Of the damaged files are made from legal ones, the others from any that had an outcome of their own."""

ROUND = 20_000
"""Files of each loader in turn, so that a run which is stopped has looked at all of them."""

DAY = 86_400.0

MOST_SEEDS = 400


class Hang(BaseException):
    """A file took longer than SECONDS, or than LOADING_SECONDS where it is the first."""


class Greed(BaseException):
    """A file took more than TIMES_LEGAL the memory of a legal one."""


class Runner:
    """One loader and what was found of it."""

    def __init__(self, name: str, home: Path):
        from targets import REFUSALS, TARGETS

        self.name, self.home, self.refusals = name, home, REFUSALS
        self.target = TARGETS[name]()
        self.seeds = list(self.target.seeds)
        self.sentences: dict[str, int] = {}
        self.found: list[str] = []
        self.files, self.cpu = 0, 0.0
        self.slowest, self.largest, self.peak = 0.0, 0, MemoryPeak()
        self.legal = {False: self._legal(self.target.seeds), True: self._legal(self.target.large)}
        for path in sorted((home / "corpus" / name).glob("*")):
            content = path.read_bytes()
            self.seeds.append((content[0] % 256, content[1:]))

    def _legal(self, seeds: list[tuple[int, bytes]]) -> int:
        """Bytes that a legal file takes, the largest of ``seeds``; libraries are loaded before."""
        growth = 0
        for seconds in (LOADING_SECONDS, SECONDS):
            for kind, content in seeds:
                self.peak.reset()
                assert self.one(kind, content, seconds) == "read", "a seed must be legal"
        for kind, content in seeds:
            self.peak.reset()
            self.one(kind, content)
            growth = max(growth, self.peak.growth)
        self.peak.reset()
        return max(growth, LEAST_LEGAL)

    def bounded(self, kind: int, content: bytes, is_large: bool = False) -> str:
        """As :meth:`one`. Raises Greed where that takes too much memory twice: once may be what a library loads."""
        bound = TIMES_LEGAL * self.legal[is_large]
        outcome = self.one(kind, content)
        if self.peak.growth > bound:
            self.peak.reset()
            self.one(kind, content)
        growth = self.peak.growth
        if growth > bound:
            bound = max(bound, TIMES_LEGAL * self.target.justified(content))
        if growth > SLACK:
            self.peak.reset()
        if growth > bound:
            raise Greed(f"{growth / 1e6:.1f} MB for a file of {len(content)} bytes, of {bound / 1e6:.1f} MB allowed")
        self.largest = max(self.largest, growth)
        return outcome

    def one(self, kind: int, content: bytes, seconds: float = SECONDS) -> str:
        """What became of it; the shape of the sentence where it was refused. Raises Hang after ``seconds`` of CPU."""
        signal.setitimer(signal.ITIMER_PROF, seconds)
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

    def watched(self, kind: int, content: bytes, is_large: bool) -> str:
        """As :meth:`bounded`; what it must not raise is kept with the file."""
        try:
            return self.bounded(kind, content, is_large)
        except (Exception, Hang, Greed) as error:
            what = f"{type(error).__name__}: {error}"[:200]
            self.keep("found", kind, content)
            self.found.append(what)
            return f"found {type(error).__name__}"

    def keep(self, where: str, kind: int, content: bytes) -> None:
        folder = self.home / where / self.name
        folder.mkdir(parents=True, exist_ok=True)
        (folder / hashlib.sha256(content).hexdigest()[:12]).write_bytes(bytes([kind]) + content)

    def run(self, count: int, seed: str, end: float) -> None:
        """Plain mutation, guided by outcomes; no file is begun after ``end`` on the monotonic clock."""
        draw = random.Random(f"{self.name}/{seed}")
        begun = time.process_time()
        for number in range(count):
            if time.monotonic() > end:
                break
            if number % BATCH == 0:
                faulthandler.dump_traceback_later(WATCHDOG, exit=True)  # what no signal interrupts
                self.peak.reset()  # memory that was given back meanwhile
            is_large = number % LARGE_EVERY == 0 and bool(self.target.large)
            legal = self.target.large if is_large else self.target.seeds
            # What was refused before is most of the seeds by and by, and is mostly refused again.
            kind, content = draw.choice(legal if is_large or draw.random() < LEGAL_SHARE else self.seeds)
            alike = [other for other_kind, other in self.seeds if other_kind == kind]
            damaged = mutated(content, alike, draw)
            outcome = self.watched(kind, damaged, is_large)
            if outcome not in self.sentences and len(self.seeds) < MOST_SEEDS and len(damaged) < 20_000:
                self.seeds.append((kind, damaged))
                self.keep("corpus", kind, damaged)
            self.sentences[outcome] = self.sentences.get(outcome, 0) + 1
            self.files += 1
        faulthandler.cancel_dump_traceback_later()
        self.cpu += time.process_time() - begun

    @property
    def row(self) -> dict[str, Any]:
        """What a record says of this loader."""
        return {
            "loader": self.name,
            "files": self.files,
            "read": self.sentences.get("read", 0),
            "outcomes": len(self.sentences),
            "found": len(self.found),
            "slowest_s": self.slowest,
            "most_mb": self.largest / 1e6,
            "allowed_mb": TIMES_LEGAL * max(self.legal.values()) / 1e6,
            "cpu_s": self.cpu,
        }


def _hang(number: int, frame: object) -> None:
    raise Hang("over its seconds of CPU")


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
        lambda data: runner.bounded(data[0] % kinds, data[1:]) if data else None,
    )  # fmt: skip
    atheris.Fuzz()


def main() -> int:
    """Exit code 1 where anything was found."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("names", nargs="*", help="loaders; by default all")
    parser.add_argument("--count", type=int, default=10_000, help="files for each loader")
    parser.add_argument("--seconds", type=float, default=DAY, help="at most so long; with --guided, for each loader")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--home", type=Path, default=Path("build/fuzz"))
    parser.add_argument("--record", type=Path, help="JSON file to write, after each loader")
    parser.add_argument("--guided", action="store_true", help="by atheris, which must be installed")
    asked = parser.parse_args()
    warnings.simplefilter("ignore")
    signal.signal(signal.SIGPROF, _hang)
    if asked.guided and not _has_atheris():
        parser.error("atheris is not installed: leave out --guided, or install it")
    if asked.guided and len(asked.names) == 1:
        guided(asked.names[0], asked.home, asked.count, asked.seconds)
    from targets import TARGETS

    names = asked.names or list(TARGETS)
    if asked.guided:  # one process each: the fuzzer ends its own
        words = [sys.executable, __file__, "--guided", "--count", str(asked.count), "--home", str(asked.home)]
        words += ["--seconds", str(asked.seconds)]
        return int(any([subprocess.run([*words, name], check=False).returncode for name in names]))
    runners = [Runner(name, asked.home) for name in names]
    mutate(runners, asked.count, asked.seed, time.monotonic() + asked.seconds, asked.record)
    for runner in runners:
        print(  # noqa: T201
            "{loader:13} {files:8} files, {read} read, {outcomes} outcomes, {found} found, slowest {slowest_s:.3f} s, "
            "most memory {most_mb:.1f} of {allowed_mb:.1f} MB, {cpu_s:.0f} s".format(**runner.row),
            *(f"\n    {what}" for what in sorted(set(runner.found))[:20]),
        )
    return int(any(runner.found for runner in runners))


def mutate(runners: list[Runner], count: int, seed: int, end: float, record: Path | None) -> None:
    """``count`` files for each, in rounds, or as many as there is time for; the record is kept up to date."""
    for first in range(0, count, ROUND):
        for runner in runners:
            runner.run(min(ROUND, count - first), f"{seed}/{first}", end)
        if record is not None:
            from long_record import write_record

            write_record(record, command=" ".join(["python", *sys.argv]), rows=[runner.row for runner in runners])


if __name__ == "__main__":
    sys.exit(main())
