"""The machine a number was measured on, as facts for the record."""

import platform
import subprocess
from dataclasses import dataclass
from pathlib import Path

import torch

import ringlight
from ringlight import _kernels
from ringlight.core.cores import usable_cores


@dataclass(frozen=True)
class Machine:
    """What speed depends on. ``threads`` is what ringlight's kernels use, ``cores`` what this process may use."""

    cpu: str
    cores: int
    threads: int
    isa: str
    gpu: str | None
    system: str
    python: str
    torch: str


def machine() -> Machine:
    """The facts of this machine and process, now."""
    return Machine(
        cpu=_cpu_model(),
        cores=usable_cores(),
        threads=_kernels.threads(),
        isa=_isa(),
        gpu=torch.cuda.get_device_name() if torch.cuda.is_available() else None,
        system=f"{platform.system()} {platform.machine()}",
        python=platform.python_version(),
        torch=torch.__version__,
    )


def source_commit() -> str | None:
    """The commit of ringlight's git checkout, with "+changes" if files differ from it; None for an installed copy."""
    package = Path(ringlight.__file__).resolve().parent
    root = package.parent.parent
    # An environment inside a checkout holds an installed copy: its path does not end in src/ringlight.
    if package.parent.name != "src" or not (root / ".git").exists():
        return None
    commit = _git(root, "rev-parse", "HEAD")
    if not commit:
        return None
    return f"{commit}+changes" if _git(root, "status", "--porcelain", "--untracked-files=no") else commit


def _git(root: Path, *arguments: str) -> str | None:
    command = ["git", "-C", str(root), *arguments]
    try:
        return subprocess.run(command, capture_output=True, text=True, check=True, timeout=10).stdout.strip()
    except (OSError, subprocess.SubprocessError):
        return None


def _isa() -> str:
    try:
        return str(_kernels.isa())
    except RuntimeError:
        return "none"


def _cpu_model() -> str:
    facts = Path("/proc/cpuinfo")
    if facts.is_file():
        for line in facts.read_text(encoding="utf-8", errors="replace").splitlines():
            key, _, value = line.partition(":")
            if key.strip() == "model name":
                return " ".join(value.split())
    return platform.processor() or platform.machine()
