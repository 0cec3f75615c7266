"""Keeps the ring's tables between renderings of an unchanged model."""

from collections.abc import Callable, Iterable

import torch
from torch import Tensor

from ringlight.fields.ring_tables import RingTables


class TableMemory:
    """Remembers one set of tables together with a copy of the parameters that they were made of.

    Values are compared, not version counters: our kernels count what they write, but numpy and others' do not. A
    comparison of some 250,000 numbers takes a tenth of a millisecond, making the tables several milliseconds. On a GPU,
    where each comparison would wait for all work before it, everything that writes to a parameter does count.
    """

    def __init__(self) -> None:
        self._made_of: list[Tensor] = []
        self._versions: list[int] = []
        self._tables: RingTables | None = None

    def recall(self, parameters: Iterable[Tensor], make: Callable[[], RingTables | None]) -> RingTables | None:
        """The remembered tables if every parameter still has the same value, else ``make()``, remembered."""
        current = [parameter.detach() for parameter in parameters]
        if self._tables is None or not self._same(current):
            self._tables = make()
            self._made_of = [parameter.clone() if parameter.is_cpu else parameter for parameter in current]
            self._versions = [parameter._version for parameter in current]
        return self._tables

    def _same(self, current: list[Tensor]) -> bool:
        if len(current) != len(self._made_of):
            return False
        if any(old.dtype != new.dtype or old.device != new.device for old, new in self._pairs(current)):
            return False
        if not all(parameter.is_cpu for parameter in current):
            versions = [parameter._version for parameter in current]
            return versions == self._versions and all(old.is_set_to(new) for old, new in self._pairs(current))
        return all(torch.equal(old, new) for old, new in self._pairs(current))

    def _pairs(self, current: list[Tensor]) -> Iterable[tuple[Tensor, Tensor]]:
        return zip(self._made_of, current, strict=True)
