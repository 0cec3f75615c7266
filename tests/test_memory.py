"""Peak memory of a training step above the parameters and their moments, in a fresh process."""

import subprocess
import sys

import pytest

BOUND_MB = 400

SIZE = (300_000, 800)

STEPS = """
import ctypes, dataclasses, gc, sys
from pathlib import Path
from ringlight.bench.workload import Size, workload, workload_scene
from ringlight.fit.train import train
from ringlight.methods.table import METHODS
from ringlight.rasterize.choose import rasterizer_for

def megabytes(key):
    [line] = [line for line in Path("/proc/self/status").read_text().splitlines() if line.startswith(key)]
    return int(line.split()[1]) / 1000

def peak_of_steps(gaussians, pixels):
    recipe = dataclasses.replace(METHODS[sys.argv[1]], steps=30_000)
    training = recipe.build(workload_scene(workload(Size(gaussians, pixels))), rasterizer_for("cpu"), seed=0)
    gc.collect()
    ctypes.CDLL(None).malloc_trim(0)
    Path("/proc/self/clear_refs").write_text("5")  # the peak counts from here
    before = megabytes("VmRSS")
    for progress in train(training):
        if progress.step == 4:
            return megabytes("VmHWM") - before

peak_of_steps(100, 32)  # what is loaded when it is first used
print(peak_of_steps(int(sys.argv[2]), int(sys.argv[3])))
"""


@pytest.mark.slow
@pytest.mark.skipif(sys.platform != "linux", reason="reads /proc")
@pytest.mark.parametrize("method", ["3dgs", "ringlight-basis", "ringlight-ring"])
def test_a_step_needs_less_than_the_bound(method: str):
    command = [sys.executable, "-c", STEPS, method, *map(str, SIZE)]
    done = subprocess.run(command, check=True, capture_output=True, text=True)
    assert 20 < float(done.stdout) < BOUND_MB, "above parameters and moments, MB"
