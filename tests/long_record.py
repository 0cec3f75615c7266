"""What a long test leaves for benchmarks/results: its figures, with version, commit, date and machine."""

import datetime
import json
from dataclasses import asdict
from pathlib import Path
from typing import Any

import ringlight
from ringlight.measure.machine import machine, source_commit


def write_record(path: Path, **figures: Any) -> None:
    """As JSON, in place of an earlier one."""
    date = datetime.datetime.now(tz=datetime.timezone.utc).date().isoformat()
    facts = {"version": ringlight.__version__, "commit": source_commit(), "date": date, "machine": asdict(machine())}
    path.write_text(json.dumps({"circumstances": facts, **figures}, indent=2) + "\n", encoding="utf-8")
