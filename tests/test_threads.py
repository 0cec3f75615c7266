"""Threads as a whole: the same bits for any number of them, forks, callers side by side, and who else spins."""

import hashlib
import os
import subprocess
import sys
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Literal

import pytest
import torch

from ringlight import _kernels
from ringlight.bench.workload import Size, workload
from ringlight.core.rendering import Emission
from ringlight.fit.strategies.densify_settings import DensifySettings
from ringlight.fit.train import train
from ringlight.methods.table import METHODS
from ringlight.rasterize.choose import rasterizer_for
from small_recipes import COARSE, TRAINED, with_settings
from tiny_scene import tiny_scene

pytestmark = pytest.mark.usefixtures("all_cores_afterwards")


def state_after(
    method: str, steps: int, threads: int, kind: Literal["adaptive", "mcmc"] = "adaptive"
) -> dict[str, torch.Tensor]:
    _kernels.set_threads(threads)
    densify = DensifySettings(kind=kind, threshold=1e-5, begin=2, every=4, stop=0.9, max_gaussians=900)
    recipe = with_settings(METHODS[method], COARSE | {"steps": steps, "densify": densify})
    training = recipe.build(tiny_scene(), rasterizer_for("cpu"), seed=1)
    for _ in train(training):
        pass
    return training.state()


@pytest.mark.parametrize("method", TRAINED)
def test_a_run_has_the_same_bits_for_any_number_of_threads(method: str):
    alone = state_after(method, 12, threads=1)
    for threads in (2, 4):
        state = state_after(method, 12, threads)
        assert state.keys() == alone.keys()
        assert [name for name in alone if not torch.equal(state[name], alone[name])] == []


def test_so_has_one_whose_gaussians_are_moved_and_shaken():
    alone = state_after("3dgs", 12, threads=1, kind="mcmc")
    before = torch.get_num_threads()
    try:
        for threads in (2, 4):
            torch.set_num_threads(threads)  # copies are drawn, and noise is made, by torch
            state = state_after("3dgs", 12, threads, kind="mcmc")
            assert [name for name in alone if not torch.equal(state[name], alone[name])] == []
    finally:
        torch.set_num_threads(before)


def picture() -> str:
    work = workload(Size(3000, 64))
    emission = Emission({"rgb": 3}, work.channels)
    raster = rasterizer_for("cpu").draw(work.gaussians, emission, work.camera, torch.zeros(3))
    return hashlib.sha256(raster.image.contiguous().numpy().tobytes()).hexdigest()


def test_callers_side_by_side_take_turns_and_get_what_they_asked_for():
    _kernels.set_threads(3)
    expected = picture()
    with ThreadPoolExecutor(4) as callers:
        assert set(callers.map(lambda _: picture(), range(24))) == {expected}


def test_processes_forked_in_the_middle_of_a_loop_have_threads_of_their_own():
    """The parent's other thread is inside the pool nearly always, so that its locks are held when it forks."""
    code = """
import multiprocessing, os, sys, threading
import torch
torch.set_num_threads(1)  # torch's own OpenMP does not survive a fork
sys.path.insert(0, sys.argv[1])
from test_threads import _kernels, picture
_kernels.set_threads(3)
expected = picture()
def in_child(number):
    _kernels.set_threads(number % 3 + 1)
    grandchild = os.fork()
    if grandchild == 0:
        os._exit(0 if picture() == expected else 1)
    return picture(), os.waitstatus_to_exitcode(os.waitpid(grandchild, 0)[1])
def keep_busy():
    while not done.is_set():
        picture()
done = threading.Event()
busy = threading.Thread(target=keep_busy)
busy.start()
with multiprocessing.get_context("fork").Pool(3) as children:
    answers = set(children.map(in_child, range(12), chunksize=1))
done.set()
busy.join()
sys.exit(answers != {(expected, 0)} or picture() != expected)
"""
    # A deadlock of one of them ends here.
    here = str(Path(__file__).parent)
    result = subprocess.run(
        [sys.executable, "-c", code, here], check=False, capture_output=True, text=True, timeout=100
    )
    assert result.returncode == 0, result.stderr[-2000:]


def told_in_a_process_of_its_own(code: str, **environment: str) -> list[str]:
    clean = {name: value for name, value in os.environ.items() if not name.startswith("OMP_")}
    done = subprocess.run(
        [sys.executable, "-c", code], env=clean | environment, check=True, capture_output=True, text=True
    )
    return done.stdout.split()


def test_torchs_threads_are_told_not_to_spin_before_they_exist():
    code = "import ringlight, os, sys; print(os.environ['OMP_WAIT_POLICY'], 'torch' in sys.modules)"
    assert told_in_a_process_of_its_own(code) == ["passive", "False"]
    assert told_in_a_process_of_its_own(code, OMP_WAIT_POLICY="active") == ["active", "False"], "the user knows better"


def test_the_option_counts_for_the_kernels_and_torchs_bits_do_not_depend_on_it():
    """Of arrays as long as this torch's own threads would do a part each, and round its end in another way."""
    code = """
from hashlib import sha256
from ringlight.cli.threads import use_threads
from ringlight import _kernels
import torch
values = torch.randn(300_009, generator=torch.Generator().manual_seed(1))
for count in (1, 3, 0):
    use_threads(count)
    found = torch.cat([values.sigmoid(), values.mean()[None]])
    print(_kernels.threads(), sha256(found.numpy()).hexdigest())
"""
    told = told_in_a_process_of_its_own(code)
    assert told[::2] == ["1", "3", str(len(os.sched_getaffinity(0)))]
    assert len(set(told[1::2])) == 1
