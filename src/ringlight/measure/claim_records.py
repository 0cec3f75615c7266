"""Our own measurements, from a folder of records: reports of runs, tables of methods, and studies.

Only runs of one kind of record are held against each other: those of a table, or those whose file names begin alike
(``readme-``, ``train-``), since these have the same settings but for the method. Tables and studies are taken to be of
one machine.
"""

import json
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from statistics import fmean
from typing import Any

from ringlight.core.json_numbers import refuse_constant
from ringlight.errors import RunError

KINDS = ("table", "readme", "train", "study")
"""What names of records begin with, the more telling first."""

LPIPS = ("lpips_vgg", "lpips_alex")
"""By the networks; those of two are never held against each other. The paper says not which it has."""

TIMED_BY = ("cpu", "gpu", "isa", "threads")
"""What of a report's machine its times depend on."""

LARGEST_RECORD = 64_000_000
"""Bytes; a larger file is no record, and is not read."""


@dataclass(frozen=True)
class Subject:
    """What was measured: a method, or the variant of a study."""

    study: str | None
    name: str


@dataclass(frozen=True)
class Record:
    """Means over ``seeds`` by measure: "psnr" dB, "ssim", those of LPIPS, "megabytes" raw, "fps", "minutes" of CPU
    time."""

    kind: str
    file: str
    scene: str
    steps: int
    subject: Subject
    seeds: tuple[int, ...]
    values: Mapping[str, float]
    machine: str | None
    """What it was timed on, with how many threads; None where that is not one."""


def records_in(folder: Path) -> tuple[Record, ...]:
    """All of a folder, the more telling kinds first; what is neither run, table nor study is left out.

    Raises RunError for a folder that is not there, and for a file that is no JSON.
    """
    if not folder.is_dir():
        raise RunError(
            f"{folder}: there is no such folder of records, which lie in the source tree; name it with --results"
        )
    found: list[Record] = []
    for kind in KINDS:
        for path in sorted(folder.glob(f"{kind}-*.json")):
            found += _records(kind, path)
    return tuple(found)


def _records(kind: str, path: Path) -> list[Record]:
    if path.stat().st_size > LARGEST_RECORD:
        raise RunError(f"{path}: is too large for a record ({path.stat().st_size:,} bytes); move it elsewhere")
    try:
        data = json.loads(path.read_text(encoding="utf-8"), parse_constant=refuse_constant)
    except (ValueError, RecursionError) as error:
        raise RunError(f"{path}: is no valid JSON ({error}); copy it again, or move it elsewhere") from None
    try:
        if kind == "study":
            return _of_study(path.name, data)
        if kind == "table":
            return _of_table(path.name, data)
        return _of_run(kind, path.name, data)
    except (KeyError, TypeError, ValueError, AttributeError) as error:
        reason = f"no {error}" if isinstance(error, KeyError) else str(error)
        raise RunError(f"{path}: is no record that this version reads ({reason}); measure it again") from None


def _of_run(kind: str, file: str, data: Mapping[str, Any]) -> list[Record]:
    if "psnr" not in data or "preset" not in data:
        return []
    scene, preset, steps = str(data["scene"]), str(data["preset"]), int(data["iterations"] or 0)
    usual = rf"readme-{re.escape(scene)}(-bundled)?-{steps}-{re.escape(preset)}(-seed\d+)?\.json"
    if kind == "readme" and not re.fullmatch(usual, file):
        return []  # what follows the method's name says what was set otherwise
    seconds = data.get("train_cpu_seconds")
    values = {
        "psnr": data["psnr"],
        "ssim": data["ssim_same"],
        **{net: data.get(net) for net in LPIPS},
        "megabytes": data["bytes_raw"] / 1e6,
        "fps": data.get("fps"),
        "minutes": seconds / 60 if seconds else None,
    }
    machine = data.get("machine")
    timed = None if not machine else json.dumps([machine.get(name) for name in TIMED_BY])
    return [Record(kind, file, scene, steps, Subject(None, preset), (int(data["seed"] or 0),), _known(values), timed)]


def _of_table(file: str, data: Mapping[str, Any]) -> list[Record]:
    runs: dict[tuple[str, str], list[Mapping[str, Any]]] = {}
    for run in data["runs"]:
        runs.setdefault((run["scene"], run["method"]), []).append(run)
    keys = {"psnr": "psnr", "ssim": "ssim", "megabytes": "raw_megabytes", "fps": "fps"} | {net: net for net in LPIPS}

    def value(key: str, scene: str, method: str) -> float | None:
        cell = data["measures"].get(key, {}).get("scenes", {}).get(scene, {}).get(method)
        return None if cell is None else float(cell["mean"])

    found = []
    for (scene, method), of_pair in runs.items():
        values = {name: value(key, scene, method) for name, key in keys.items()}
        seconds = value("core_seconds", scene, method)
        values["minutes"] = None if seconds is None else seconds / 60
        seeds = tuple(sorted(int(run["seed"]) for run in of_pair))
        if values["psnr"] is not None:
            steps = int(of_pair[0]["steps"])
            found.append(Record(file, file, scene, steps, Subject(None, method), seeds, _known(values), file))
    return found


def _of_study(file: str, data: Mapping[str, Any]) -> list[Record]:
    found = []
    for row in data["rows"]:
        seconds = row.get("core_seconds") or row.get("train_cpu_seconds")
        values = {
            "psnr": row["psnr"]["mean"],
            "ssim": row["ssim"]["mean"],
            **{net: row[net]["mean"] for net in LPIPS if row.get(net) is not None},
            "megabytes": row["raw_megabytes"]["mean"],
            "minutes": seconds["mean"] / 60 if seconds else None,
        }
        subject = Subject(str(data["study"]), str(row["variant"]))
        seeds = tuple(range(int(row["seeds"])))
        found.append(Record("study", file, str(row["scene"]), int(data["steps"]), subject, seeds, _known(values), file))
    return found


def _known(values: Mapping[str, Any]) -> dict[str, float]:
    return {name: float(value) for name, value in values.items() if value is not None}


def joined(records: Sequence[Record]) -> Record:
    """One of several seeds, of at least one record of the same kind, scene, steps and subject."""
    first = records[0]
    names = set.intersection(*(set(record.values) for record in records))
    values = {name: fmean(record.values[name] for record in records) for name in first.values if name in names}
    files = ", ".join(dict.fromkeys(record.file for record in records))
    seeds = tuple(sorted({seed for record in records for seed in record.seeds}))
    machine = first.machine if {record.machine for record in records} == {first.machine} else None
    return Record(first.kind, files, first.scene, first.steps, first.subject, seeds, values, machine)
