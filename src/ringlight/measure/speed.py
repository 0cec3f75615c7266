"""Speed: frames per second of a render call, and what this machine can do at best."""

import time
import timeit
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from statistics import median

import torch

from ringlight import _kernels
from ringlight.core.camera import Camera, picture_sizes
from ringlight.core.rendering import Rendering
from ringlight.core.words import counted

MATRIX_SIDE = 1024
"""2 GFLOP a product: milliseconds on any machine, and long enough to reach full speed."""

COPY_BYTES = 128 * 2**20
"""Larger than the last-level cache of most processors, so that memory is measured."""

PASSES, MAX_SECONDS = 3, 30.0
"""Passes over the cameras that are timed; none is begun after so long, the one that warms up included."""

WARM_SECONDS = 10.0
"""No picture is begun after so long to warm up. Of a volume one takes seconds, and the second is as fast as the last.
"""

FMA_ROUNDS = 20_000
"""Of each piece: a millisecond or less on any machine."""

REPEATS = 15
"""A peak is what the machine can do when nobody disturbs: the best of so many."""


@dataclass(frozen=True)
class FrameRate:
    """How fast a model shows pictures; ``note`` says what was timed."""

    fps: float
    note: str


def frames_per_second(render: Callable[[Camera], Rendering], cameras: Sequence[Camera]) -> FrameRate:
    """Time the render call alone, all cameras one after the other, without gradients.

    No pass is begun after MAX_SECONDS, but one is always timed, so that a slow back end gets its number too. Where it
    could not show all cameras in that time, it is timed with as many of them as it can, evenly spread.
    CUDA work is waited for before each reading of the clock. There must be at least one camera.
    """
    begun = time.perf_counter()
    times: list[float] = []
    with torch.no_grad():
        device = render(cameras[0]).color.device
        warmed = _warm_up(render, cameras, device)
        fits = max(int(MAX_SECONDS / median(warmed)), 1)
        timed = cameras if len(cameras) <= fits else [cameras[k * len(cameras) // fits] for k in range(fits)]
        while not times or (len(times) < PASSES and time.perf_counter() - begun < MAX_SECONDS):
            times.append(_one_pass(render, timed, device))
    first = "1" if len(warmed) == len(cameras) else counted(len(warmed), "view")
    note = (
        f"render call only, {counted(len(timed), 'view')} of {picture_sizes(timed, ' to ')}, one at a time, median of "
        f"{len(times)} {'pass' if len(times) == 1 else 'passes'} after {first} to warm up, on {device_name(device)}"
    )
    return FrameRate(len(timed) / median(times), note)


def fma_gflops() -> float:
    """GFLOP/s of fused multiply-adds in registers, on the kernels' threads and instruction set, fastest of all."""
    sums = torch.empty(8 * _kernels.threads(), dtype=torch.float32, device="cpu")
    done = _kernels.multiply_adds(1, sums) * FMA_ROUNDS
    return done / _best_seconds(lambda: _kernels.multiply_adds(FMA_ROUNDS, sums)) / 1e9


def peak_gflops() -> float:
    """GFLOP/s of torch's float32 matrix product (1024 cubed) on this machine's CPU, fastest of all."""
    a, b = torch.ones(MATRIX_SIDE, MATRIX_SIDE), torch.ones(MATRIX_SIDE, MATRIX_SIDE)
    out = torch.empty_like(a)
    with torch_threads(_kernels.threads()):
        seconds = _best_seconds(lambda: torch.mm(a, b, out=out))
    return 2 * MATRIX_SIDE**3 / seconds / 1e9


def copy_bandwidth() -> float:
    """GB/s of a copy within main memory, bytes read plus bytes written, fastest of all."""
    source = torch.ones(COPY_BYTES // 4)
    target = torch.empty_like(source)
    with torch_threads(_kernels.threads()):
        return 2 * COPY_BYTES / _best_seconds(lambda: target.copy_(source)) / 1e9


@contextmanager
def torch_threads(count: int) -> Iterator[None]:
    """So many threads for torch meanwhile: training gives it one, and what is measured of it deserves the kernels'."""
    before = torch.get_num_threads()
    torch.set_num_threads(count)
    try:
        yield
    finally:
        torch.set_num_threads(before)


def _warm_up(render: Callable[[Camera], Rendering], cameras: Sequence[Camera], device: torch.device) -> list[float]:
    """Seconds of each camera, until all were shown or WARM_SECONDS are over."""
    seconds: list[float] = []
    for camera in cameras:
        seconds.append(_one_pass(render, [camera], device))
        if sum(seconds) >= WARM_SECONDS:
            break
    return seconds


def _one_pass(render: Callable[[Camera], Rendering], cameras: Sequence[Camera], device: torch.device) -> float:
    """Seconds for all cameras once."""
    _wait_for(device)
    begun = time.perf_counter()
    for camera in cameras:
        render(camera)
    _wait_for(device)
    return max(time.perf_counter() - begun, 1e-9)


def _wait_for(device: torch.device) -> None:
    if device.type == "cuda":
        torch.cuda.synchronize(device)


def device_name(device: torch.device) -> str:
    """As a reader would call it, with the kernels' threads."""
    if device.type == "cuda":
        return torch.cuda.get_device_name(device)
    return f"the CPU ({counted(_kernels.threads(), 'thread')})"


def _best_seconds(work: Callable[[], object]) -> float:
    return min(timeit.repeat(work, repeat=REPEATS + 1, number=1)[1:])  # the first warms up
