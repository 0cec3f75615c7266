"""A device that is not the CPU, on the CPU: for tests of what runs on a GPU, without one.

Tensors on it keep their numbers in a CPU tensor that nobody else can reach. As on a GPU, native kernels and numpy
cannot read them, an operation on tensors of both devices is an error, and so is a factory that forgets the device.
"""

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any

import torch
from torch import Tensor
from torch.overrides import TorchFunctionMode
from torch.utils._python_dispatch import TorchDispatchMode

ELSEWHERE = torch.device("lazy")
"""A type that torch knows, has no code for, and differentiates on the calling thread."""


class _There(Tensor):
    """A tensor that says it is on the other device; ``numbers`` holds what it is made of."""

    numbers: Tensor

    @staticmethod
    def __new__(cls, numbers: Tensor) -> "_There":
        made = Tensor._make_wrapper_subclass(
            cls, numbers.shape, strides=numbers.stride(), storage_offset=numbers.storage_offset(),
            dtype=numbers.dtype, device=ELSEWHERE,
        )  # fmt: skip
        made.numbers = numbers
        return made

    @classmethod
    def __torch_dispatch__(cls, function, types, arguments=(), named=None):
        return _run(function, arguments, named or {})


@contextmanager
def other_device() -> Iterator[torch.device]:
    """While it is entered, there is a device that one can move tensors to and make tensors on."""
    with _Operations(), _Literals():
        yield ELSEWHERE


class _Operations(TorchDispatchMode):
    def __torch_dispatch__(self, function, types, arguments=(), named=None):
        return _run(function, arguments, named or {})


class _Literals(TorchFunctionMode):
    """Tensors made of Python's numbers, which torch fills out of reach of the other mode."""

    def __torch_function__(self, function, types, arguments=(), named=None):
        named = named or {}
        if function is Tensor.new_tensor and isinstance(arguments[0], _There):
            return torch.tensor(arguments[1], dtype=arguments[0].dtype).to(ELSEWHERE)
        if function is Tensor.tolist and isinstance(arguments[0], _There):
            return arguments[0].cpu().tolist()
        if function is torch.tensor and torch.device(named.get("device") or "cpu").type == ELSEWHERE.type:
            return torch.tensor(*arguments, **named | {"device": "cpu"}).to(ELSEWHERE)
        return function(*arguments, **named)


def _run(function: Any, arguments: tuple[Any, ...], named: dict[str, Any]) -> Any:
    found = [*_tensors_in(arguments), *_tensors_in(list(named.values()))]
    there = [tensor for tensor in found if isinstance(tensor, _There)]
    target = named.get("device")
    moves = function in (torch.ops.aten._to_copy.default, torch.ops.aten.copy_.default)
    strangers = [tensor for tensor in found if not isinstance(tensor, _There) and tensor.ndim]
    if there and strangers and not moves:
        raise RuntimeError(f"{function}: tensors on both devices, {[tuple(t.shape) for t in found]}")
    plain = named if target is None else named | {"device": torch.device("cpu")}
    if plain.get("pin_memory"):
        plain = plain | {"pin_memory": False}
    result = function(*_each(_numbers, arguments), **{name: _each(_numbers, value) for name, value in plain.items()})
    if function is torch.ops.aten.copy_.default or function._schema.is_mutable:
        return _as_given(result, found)
    stays = torch.device(target).type == ELSEWHERE.type if target is not None else bool(there)
    return _each(lambda value: _There(value) if isinstance(value, Tensor) else value, result) if stays else result


def _each(change: Callable[[Any], Any], values: Any) -> Any:
    """What holds the values, with each changed; operators are given nothing but lists and tuples of them. Torch's own
    tree_map takes most of these tests' time."""
    return type(values)(_each(change, value) for value in values) if type(values) in (list, tuple) else change(values)


def _tensors_in(values: Any) -> Iterator[Tensor]:
    if type(values) in (list, tuple):
        for value in values:
            yield from _tensors_in(value)
    elif isinstance(values, Tensor):
        yield values


def _numbers(value: Any) -> Any:
    return value.numbers if isinstance(value, _There) else value


def _as_given(result: Any, found: list[Tensor]) -> Any:
    """An operation in place returns the very tensor that it was given."""
    owners = {id(_numbers(tensor)): tensor for tensor in found}
    return _each(lambda value: owners.get(id(value), value) if isinstance(value, Tensor) else value, result)
