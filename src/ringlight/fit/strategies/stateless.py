"""What strategies have in common that add no rows and count nothing."""

from collections.abc import Mapping

from torch import Tensor


class Stateless:
    """Base of strategies; see :class:`ringlight.fit.strategies.contract.Strategy`."""

    most: int | None = None

    def state(self) -> dict[str, Tensor]:
        return {}

    def restore(self, state: Mapping[str, Tensor]) -> None:
        """Nothing is counted."""
