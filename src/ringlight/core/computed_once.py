"""A property that is worked out once, when it is first asked for.

``functools.cached_property`` does that under a lock before Python 3.12: a process that is forked while another thread
holds it waits for ever.
"""

from collections.abc import Callable
from typing import Any, Generic, TypeVar, overload

Value = TypeVar("Value")


class computed_once(Generic[Value]):
    """Decorates a method without arguments; the object keeps the value in its ``__dict__``, under the method's name."""

    def __init__(self, work_out: Callable[[Any], Value]):
        self._work_out, self.__doc__ = work_out, work_out.__doc__

    def __set_name__(self, owner: type, name: str) -> None:
        self._name = name

    @overload
    def __get__(self, instance: None, owner: type) -> "computed_once[Value]": ...
    @overload
    def __get__(self, instance: object, owner: type) -> Value: ...

    def __get__(self, instance: object | None, owner: type) -> "computed_once[Value] | Value":
        if instance is None:
            return self
        value = instance.__dict__[self._name] = self._work_out(instance)
        return value
