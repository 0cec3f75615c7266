"""What every benchmark states about its circumstances, and where quoted results are kept."""

import os
import re
from dataclasses import dataclass
from pathlib import Path

import ringlight
from ringlight.errors import OutputError, RecipeError
from ringlight.files.atomic import write_text
from ringlight.measure.json_record import to_json
from ringlight.measure.machine import Machine, machine, source_commit
from ringlight.measure.speed import copy_bandwidth, fma_gflops, peak_gflops

RESULTS = Path("benchmarks", "results")
"""Below the current folder."""

BUSY_MARGIN = 1.0
"""Load above the number of cores: this process by itself reaches about that number."""

NAME = re.compile(r"[\w][\w.+-]*")


@dataclass(frozen=True)
class Circumstances:
    """Facts that decide what the times mean; the three peaks are measured in the same run, on the same threads."""

    version: str
    commit: str | None
    date: str
    machine: Machine
    fma_gflops: float
    """float32 multiply-adds in registers, GFLOP/s: nothing that computes is faster."""
    matrix_gflops: float
    """float32 matrix product, GFLOP/s."""
    copy_gbs: float
    """Copy within main memory, GB/s, bytes read plus bytes written."""
    load: float | None
    """Processes that wanted to run, mean of the last minute; None where the system does not say."""

    @property
    def is_busy(self) -> bool:
        """Whether others took part of the cores, so that wall times say little."""
        return self.load is not None and self.load > self.machine.cores + BUSY_MARGIN


def circumstances(date: str) -> Circumstances:
    """Measured now; ``date`` is the caller's, since the library does not look at the calendar."""
    load = os.getloadavg()[0] if hasattr(os, "getloadavg") else None
    return Circumstances(
        version=ringlight.__version__,
        commit=source_commit(),
        date=date,
        machine=machine(),
        fma_gflops=fma_gflops(),
        matrix_gflops=peak_gflops(),
        copy_gbs=copy_bandwidth(),
        load=load,
    )


def result_path(name: str) -> Path:
    """Where the result of that name is kept. Raises RecipeError for a name that is no plain file name."""
    if not NAME.fullmatch(name):
        raise RecipeError(f"{name!r} is no name for a result; use letters, digits, dots and dashes, as in raster-avx2")
    return RESULTS / f"{name.removesuffix('.json')}.json"


def save_result(record: object, name: str) -> Path:
    """Write benchmarks/results/NAME.json, in place of an earlier result of that name.

    Raises RecipeError for a name that is no plain file name, OutputError where nothing can be written.
    """
    path = result_path(name)
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise OutputError(f"{path.parent}: cannot be made ({error.strerror}); run it in another folder") from None
    write_text(path, to_json(record))
    return path
