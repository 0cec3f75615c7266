"""Whether training repeats itself to the bit on this machine: the same steps once more, and in other circumstances."""

import hashlib
import tempfile
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path

import torch
from torch import Tensor

from ringlight import _kernels
from ringlight.core.scene import Scene
from ringlight.core.want import Want
from ringlight.core.words import counted
from ringlight.files.tensor_file import read_tensors, write_tensors
from ringlight.fit.train import Training, train
from ringlight.methods.recipe import Recipe
from ringlight.rasterize.choose import rasterizer_for


@dataclass(frozen=True)
class Trial:
    """One way of doing the steps, and where it left the first: None, or the step whose loss was the first to differ.

    ``differing`` names the tensors of the final state, moments and counters included, whose bits are others; ``digest``
    is a hash of all of them, to be compared between machines.
    """

    circumstances: str
    digest: str
    first_step: int | None = None
    differing: tuple[str, ...] = ()

    @property
    def is_same(self) -> bool:
        """Whether every loss on the way and every bit at the end are those of the first."""
        return self.first_step is None and not self.differing


@dataclass(frozen=True)
class _Outcome:
    losses: list[float]
    state: dict[str, Tensor]


def verify(
    recipe: Recipe, scene: Scene, seed: int, device: str, steps: int, use_threads: Callable[[int], None]
) -> Iterator[Trial]:
    """Do the first ``steps`` of a run four times, by a recipe that leaves nothing open.

    ``use_threads`` sets the number of threads.

    The first trial is the yardstick of the others: once more, with another number of threads, and stopped halfway,
    written to disk and read back, with a photograph's view drawn after each step.
    """

    def begin() -> Training:
        return recipe.build(scene, rasterizer_for(device), seed)

    threads = _kernels.threads()
    others = 1 if threads > 1 else 2
    first = _finish(begin(), steps)
    yield Trial(f"{counted(steps, 'step')}, {counted(threads, 'thread')}", digest_of(first.state))
    yield _compared("once more", _finish(begin(), steps), first)
    use_threads(others)
    try:
        yield _compared(f"with {counted(others, 'thread')}", _finish(begin(), steps), first)
    finally:
        use_threads(threads)
    yield _compared(
        f"stopped after step {steps // 2} and resumed, a view drawn after each step",
        _interrupted(begin(), begin(), scene, steps),
        first,
    )


def digest_of(state: Mapping[str, Tensor]) -> str:
    """A hash of names, types, shapes and bits."""
    summed = hashlib.blake2b(digest_size=8)
    for name, tensor in sorted(state.items()):
        summed.update(f"{name} {tensor.dtype} {tuple(tensor.shape)}".encode())
        summed.update(tensor.detach().cpu().contiguous().reshape(-1).view(torch.uint8).numpy().data)
    return summed.hexdigest()


def _finish(training: Training, steps: int, after_step: Callable[[], object] = lambda: None) -> _Outcome:
    losses: list[float] = []
    progress = train(training)
    while training.step < steps:
        losses.append(next(progress).loss)
        after_step()
    return _Outcome(losses, training.state())


def _interrupted(training: Training, fresh: Training, scene: Scene, steps: int) -> _Outcome:
    def draw() -> None:
        with torch.no_grad():
            training.model.render((*scene.test, *scene.train)[0].camera, scene.background_color, Want.PICTURE)

    before = _finish(training, steps // 2, draw)
    with tempfile.TemporaryDirectory(prefix="ringlight-") as folder:
        write_tensors(Path(folder) / "half", before.state, {})
        fresh.restore(read_tensors(Path(folder) / "half").tensors)
    after = _finish(fresh, steps)
    return _Outcome(before.losses + after.losses, after.state)


def _compared(circumstances: str, outcome: _Outcome, first: _Outcome) -> Trial:
    pairs = enumerate(zip(outcome.losses, first.losses, strict=True), start=1)
    step = next((step for step, (loss, wanted) in pairs if loss != wanted), None)
    differing = {name for name, _ in _digests(outcome.state) ^ _digests(first.state)}
    return Trial(circumstances, digest_of(outcome.state), step, tuple(sorted(differing)))


def _digests(state: Mapping[str, Tensor]) -> set[tuple[str, str]]:
    """Each tensor's name and hash."""
    return {(name, digest_of({name: tensor})) for name, tensor in state.items()}
