"""What kernels of volumes are given is checked before memory is read: an array that is a row short is refused."""

from collections.abc import Iterator
from typing import Any

import pytest
import torch
from torch import Tensor

from ringlight import _kernels
from ringlight.core.want import Want
from ringlight.data.rays import RayBatch
from ringlight.volume.tt_sampling import from_points
from volume.trains import drawn_cores
from volume.volumes import BACKGROUND, rays, volume, volume_of_trains

RAYS = 40

Place = tuple[int, ...]
"""Of an array among a call's arguments, which may be tuples or lists of arrays."""


Calls = dict[tuple[str, int], tuple[Any, ...]]
"""By kernel and by how many factors it was given, if any."""


def recorded(monkeypatch: pytest.MonkeyPatch) -> Calls:
    """The first call of each kernel of volumes and trains, of each form, in steps of all."""
    calls: Calls = {}
    for name in dir(_kernels):
        if name.startswith(("volume_", "train_")):
            monkeypatch.setattr(_kernels, name, recording(name, getattr(_kernels, name), calls))
    for model in (volume(), volume("cp", (96, 288)), volume_of_trains()):
        model.gradient_share = 0.5
        model.meets_something(rays(RAYS))
        shown = model.predict(RayBatch(rays(RAYS), torch.zeros(RAYS, 3), BACKGROUND), Want.GRADIENTS)
        shown.backward(torch.ones(RAYS, 3), {"depth": torch.ones(RAYS, 1), "alpha": torch.ones(RAYS, 1)})
        model.density_values(torch.rand(9, 3))
    cores = [core.float().requires_grad_() for core in drawn_cores(3, 4, 6)]
    from_points(cores, torch.rand(50, 3), 2).sum().backward()
    monkeypatch.undo()
    return calls


def recording(name: str, kernel: Any, calls: Calls) -> Any:
    def called(*arguments: Any) -> Any:
        calls.setdefault((name, factors_in(name, arguments)), copied(arguments))
        return kernel(*arguments)

    return called


def factors_in(name: str, arguments: Any) -> int:
    """Six of planes times lines, three of lines, none of what takes no factors."""
    if name in FACTORS and not isinstance(arguments[0], Tensor):
        for place in FACTORS[name]:
            arguments = arguments[place]
        return len(arguments)
    return len(arguments[0]) if name == "volume_scatter" else 0


def copied(arguments: Any) -> Any:
    """Before a kernel writes to some of them."""
    if isinstance(arguments, tuple | list):
        return type(arguments)(copied(argument) for argument in arguments)
    return arguments.detach().clone() if isinstance(arguments, Tensor) else arguments


def arrays(arguments: Any, at: Place = ()) -> Iterator[Place]:
    """Where there are some that have rows."""
    if isinstance(arguments, Tensor):
        if arguments.dim() and len(arguments):
            yield at
    elif isinstance(arguments, tuple | list):
        for number, argument in enumerate(arguments):
            yield from arrays(argument, (*at, number))


def with_a_row_less(arguments: Any, at: Place) -> Any:
    if not at:
        return arguments[:-1].clone()
    changed = [with_a_row_less(value, at[1:]) if n == at[0] else value for n, value in enumerate(arguments)]
    return tuple(changed) if isinstance(arguments, tuple) else changed


def test_kernels_refuse_arrays_that_are_a_row_short(monkeypatch: pytest.MonkeyPatch):
    calls = recorded(monkeypatch)
    assert len(calls) > 15, sorted(calls)
    taken = []
    for (name, factors), arguments in calls.items():
        getattr(_kernels, name)(*copied(arguments))
        for at in arrays(arguments):
            try:
                getattr(_kernels, name)(*copied(with_a_row_less(arguments, at)))
            except (ValueError, TypeError):
                continue
            taken.append((name, factors, at))
    of_lines = {(name, at) for name, factors, at in taken if factors == 3}
    assert {(name, at) for name, factors, at in taken if factors != 3} == set(TAKEN)
    lines = {(name, (*at, line)) for name, at in FACTORS.items() for line in range(3)}
    assert of_lines == lines | {(name, at) for name, at in TAKEN if name in FACTORS or name == "volume_scatter"}
    assert {factors for name, factors in calls if name == "volume_scatter"} == {3, 6}


TAKEN: list[tuple[str, Place]] = [
    ("train_count", (0,)),  # points alone say how many there are
    ("train_touch", (0,)),
    ("volume_count", (1, 1)),  # cells of what is not empty, as many as there are
    ("volume_march", (1, 1)),
    ("volume_place", (1, 1)),
    ("train_gather", (1,)),  # rows that numbers point at, of which nothing points at the last
    ("train_scatter", (2,)),
    ("volume_scatter", (1,)),
    ("volume_shade", (0, 1)),
    ("volume_shade", (3,)),
    ("volume_shade_gradient", (0, 1)),
    ("volume_shade_gradient", (3,)),
]
"""Arrays that may be shorter."""

FACTORS: dict[str, Place] = {
    "volume_march": (2,),
    "volume_density": (0,),
    "volume_shade": (0, 0),
    "volume_shade_gradient": (0, 0),
}
"""Where kernels take planes and lines; each of three lines alone has as many nodes as it has."""


def test_kernels_refuse_three_lines_that_do_not_fit():
    lines, planes = [torch.rand(5, 16) for _ in range(3)], [torch.rand(5, 5, 16) for _ in range(3)]
    places = torch.rand(4, 3)
    with pytest.raises(ValueError, match="three planes and three lines, or three lines"):
        _kernels.volume_density(lines[:2], places, torch.empty(4))
    with pytest.raises(ValueError, match="multiple of 16"):
        _kernels.volume_density([line[:, :15].contiguous() for line in lines], places, torch.empty(4))
    for wrong in (lines[0][:1], torch.rand(5, 32)):
        with pytest.raises(ValueError, match="2 to 4096 nodes"):
            _kernels.volume_density([lines[0], wrong, lines[2]], places, torch.empty(4))
    numbers, gradient = torch.arange(4, dtype=torch.int32), torch.rand(4)
    for wrong in ([*planes, *lines], [lines[0][:4], *lines[1:]]):
        with pytest.raises(ValueError, match="must have the factors' sizes"):
            _kernels.volume_scatter(lines, places, numbers, gradient, wrong)
    with pytest.raises(ValueError, match="a gradient for each sample"):
        _kernels.volume_scatter(lines, places, numbers, torch.rand(4, 48), lines)
