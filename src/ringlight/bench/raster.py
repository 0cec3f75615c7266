"""Speed of a rasterizer on the standard workload, if wished beside another one on the same inputs."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import Protocol

import torch
from jaxtyping import Float
from torch import Tensor

from ringlight.bench.flops import Pairs
from ringlight.bench.kernels_alone import RasterKernel
from ringlight.bench.record import Circumstances
from ringlight.bench.timing import SHORTEST_MS, TOTAL, Budget, Contestant, Timing, interleaved
from ringlight.bench.workload import Size, Workload, workload
from ringlight.core.gaussians import GEOMETRY, Gaussians
from ringlight.core.randomness import generator
from ringlight.rasterize.contract import Rasterizer

FORWARD, BACKWARD = "forward", "backward"
NATIVE = "cpu"
"""The rasterizer whose kernels are also timed alone."""


class Peer(Protocol):
    """Another implementation, set up for one workload; ``image`` is planar [C H W] once ``forward`` has run."""

    image: Float[Tensor, "C H W"]

    def forward(self) -> None: ...
    def backward(self) -> None: ...


PeerMaker = Callable[[Workload, Float[Tensor, "C H W"]], Peer]
"""From a workload and the gradient of its image."""


@dataclass(frozen=True)
class Passes:
    """One rasterizer on one workload; ``both`` is the median of the sums, not the sum of the medians."""

    forward: Timing
    backward: Timing
    both: Timing


@dataclass(frozen=True)
class RasterRow:
    """One size. Ratios are our forward + backward over the peer's, of medians; on a busy machine trust CPU time."""

    size: Size
    visible: int
    """Gaussians that reach the image."""
    ours: Passes
    kernels: Passes | None = None
    """Our compiled kernels alone, without autograd and new arrays; None for another rasterizer than the CPU's."""
    pairs: Pairs | None = None
    gflops: float | None = None
    """Operations of blending (``bench/flops.py``) over the whole time of the kernels alone, fastest round."""
    peer: Passes | None = None
    wall_ratio: float | None = None
    cpu_ratio: float | None = None
    largest_difference: float | None = None
    """Of a channel of a pixel, between the two images."""


@dataclass(frozen=True)
class RasterBench:
    """What ``ringlight bench raster`` measured. ``peer`` names what was run beside it."""

    circumstances: Circumstances
    rasterizer: str
    peer: str | None
    rows: tuple[RasterRow, ...]


class OurRaster:
    """The contract's call with gradients recorded, and the gradient of all five inputs through autograd.

    This is what a training step does: gradients are those of the stored parameters, activations included. The loss
    does not look at alpha.
    """

    def __init__(self, work: Workload, upstream: Float[Tensor, "C H W"], rasterize: Rasterizer):
        there = rasterize.device
        columns = {n: getattr(work.gaussians, n).to(there, copy=True).requires_grad_() for n in GEOMETRY}
        self.gaussians = Gaussians.from_columns(columns)
        self.channels = work.channels.to(there, copy=True).requires_grad_()
        self.camera, self.rasterize = work.camera, rasterize
        self.background = torch.ones(work.size.channels)
        self.leaves = [*columns.values(), self.channels]
        # Planar memory, as the losses give it.
        self.upstream = upstream.to(there).permute(1, 2, 0)

    def forward(self) -> None:
        self.raster = self.rasterize(self.gaussians, self.channels, self.camera, self.background)

    def backward(self) -> None:
        self.gradients = torch.autograd.grad(self.raster.image, self.leaves, self.upstream)

    @property
    def image(self) -> Float[Tensor, "C H W"]:
        """What the last forward pass drew."""
        return self.raster.image.detach().cpu().permute(2, 0, 1)


def bench_raster(
    sizes: Sequence[Size],
    rasterize: Rasterizer,
    budget: Budget,
    peer: PeerMaker | None = None,
    seed: int = 0,
) -> tuple[RasterRow, ...]:
    """Time every size; ``peer`` takes turns on the same inputs."""
    return tuple(_row(size, rasterize, budget, peer, seed) for size in sizes)


def image_gradient(size: Size, seed: int = 0) -> Float[Tensor, "C H W"]:
    """A random dL/dimage of the size that a mean over pixels has."""
    shape = (size.channels, size.pixels, size.pixels)
    return torch.randn(shape, generator=generator(seed, 0, "image gradient")) / (size.pixels * size.pixels)


def _row(size: Size, rasterize: Rasterizer, budget: Budget, peer: PeerMaker | None, seed: int) -> RasterRow:
    work, upstream = workload(size, seed), image_gradient(size, seed)
    ours = OurRaster(work, upstream, rasterize)
    contestants = {"ours": Contestant({FORWARD: ours.forward, BACKWARD: ours.backward})}
    kernels = None
    if rasterize.name == NATIVE:
        kernels = RasterKernel(work.gaussians, work.channels, work.camera, ours.background)
        contestants["kernels"] = Contestant({FORWARD: kernels.forward, BACKWARD: partial(kernels.backward, upstream)})
    theirs = peer(work, upstream) if peer else None
    if theirs:
        contestants["peer"] = Contestant({FORWARD: theirs.forward, BACKWARD: theirs.backward})
    timings = {name: _passes(stages) for name, stages in interleaved(contestants, budget).items()}
    row = RasterRow(size, int(ours.raster.footprint.visible.sum()), timings["ours"])
    if kernels:
        row = _counted(row, timings["kernels"], Pairs(*kernels.count_pairs()))
    return _beside(row, timings["peer"], ours.image, theirs.image) if theirs else row


def _counted(row: RasterRow, kernels: Passes, pairs: Pairs) -> RasterRow:
    seconds = max(kernels.both.best_ms, SHORTEST_MS) / 1e3
    return replace(row, kernels=kernels, pairs=pairs, gflops=pairs.flops(row.size.channels) / seconds / 1e9)


def _beside(row: RasterRow, peer: Passes, ours: Tensor, theirs: Tensor) -> RasterRow:
    return replace(
        row,
        peer=peer,
        wall_ratio=row.ours.both.wall_ms / max(peer.both.wall_ms, SHORTEST_MS),
        cpu_ratio=row.ours.both.cpu_ms / max(peer.both.cpu_ms, SHORTEST_MS),
        largest_difference=float((ours - theirs).abs().max()),
    )


def _passes(stages: dict[str, Timing]) -> Passes:
    return Passes(stages[FORWARD], stages[BACKWARD], stages[TOTAL])
