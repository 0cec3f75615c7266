"""The smallest of what machine, container and limits allow."""

import os
import resource
import subprocess
import sys
from pathlib import Path

import pytest

from ringlight.core import memory
from ringlight.core.memory import machine_memory


def test_it_is_the_machines_or_less():
    physical = os.sysconf("SC_PAGE_SIZE") * os.sysconf("SC_PHYS_PAGES")
    assert 0 < machine_memory() <= physical


@pytest.mark.parametrize("name", ["memory.max", "memory/memory.limit_in_bytes"])
@pytest.mark.parametrize(("text", "expected"), [("1000000\n", 1_000_000), ("max\n", None), (str(2**63 - 4096), None)])
def test_a_container_may_have_less(
    name: str, text: str, expected: int | None, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
):
    monkeypatch.setattr(memory, "CGROUPS", tmp_path)
    without = machine_memory()
    (tmp_path / name).parent.mkdir(exist_ok=True)
    (tmp_path / name).write_text(text)
    assert machine_memory() == (expected or without)


@pytest.mark.parametrize(
    ("line", "file"),
    [
        ("0::/user.slice/run-7.scope", "user.slice/run-7.scope/memory.max"),
        ("0::/user.slice/run-7.scope", "user.slice/memory.max"),
        ("4:memory:/docker/abc", "memory/docker/abc/memory.limit_in_bytes"),
        ("4:memory:/docker/abc", "memory/docker/memory.limit_in_bytes"),
    ],
)
def test_so_may_the_group_of_this_process_or_one_above_it(
    line: str, file: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
):
    (tmp_path / "own").write_text(f"9:name=systemd:/\n{line}\n")
    monkeypatch.setattr(memory, "CGROUPS", tmp_path)
    monkeypatch.setattr(memory, "OWN_GROUPS", tmp_path / "own")
    (tmp_path / file).parent.mkdir(parents=True, exist_ok=True)
    (tmp_path / file).write_text("2000000\n")
    (tmp_path / "elsewhere").mkdir()
    (tmp_path / "elsewhere" / "memory.max").write_text("1000000\n")
    assert machine_memory() == 2_000_000


def test_so_may_a_process():
    code = "from ringlight.core.memory import machine_memory; print(machine_memory())"
    bound = 3 << 30

    def limit() -> None:
        resource.setrlimit(resource.RLIMIT_AS, (bound, bound))

    done = subprocess.run([sys.executable, "-c", code], preexec_fn=limit, check=True, capture_output=True, text=True)
    assert int(done.stdout) <= bound
