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


def test_so_may_a_process():
    code = "from ringlight.core.memory import machine_memory; print(machine_memory())"
    bound = 3 << 30

    def limit() -> None:
        resource.setrlimit(resource.RLIMIT_AS, (bound, bound))

    done = subprocess.run([sys.executable, "-c", code], preexec_fn=limit, check=True, capture_output=True, text=True)
    assert int(done.stdout) <= bound
