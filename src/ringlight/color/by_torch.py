"""Colour models that only know torch: what they emit as a record that knows its way back."""

from collections.abc import Callable, Mapping

import torch
from torch import Tensor

from ringlight.core.by_autograd import ByAutograd
from ringlight.core.gradients import COLUMNS, Gradients
from ringlight.core.rendering import Channels, Emission
from ringlight.core.want import Want

OPACITY_FACTOR = "opacity_factor"
"""Reserved name, [N 1]: it multiplies the opacity and is not blended."""


def emitted_by_torch(
    function: Callable[[dict[str, Tensor]], Channels],
    columns: dict[str, Tensor],
    parameters: Mapping[str, Tensor],
    want: Want,
) -> Emission:
    """``function`` makes channels [N c] by name, and "opacity_factor" if there is one, of the table's ``columns``.

    ``parameters`` are the shared ones that it reads, by full name.
    """
    if want is not Want.GRADIENTS:
        with torch.no_grad():
            return _emission(function(columns))
    recorded = ByAutograd(function, columns, parameters)
    names = [name for name in recorded.outputs if name != OPACITY_FACTOR]
    widths = [recorded.outputs[name].shape[-1] for name in names]

    def backward(grad_channels: Tensor, grad_opacity_factor: Tensor | None, into: Gradients) -> None:
        outputs: dict[str, Tensor | None] = dict(zip(names, grad_channels.split(widths, -1), strict=True))
        outputs[OPACITY_FACTOR] = None if grad_opacity_factor is None else grad_opacity_factor[:, None]
        found = recorded.backward(outputs)
        into.add_all({COLUMNS + name if name in columns else name: gradient for name, gradient in found.items()})

    return _emission(recorded.outputs, backward)


def _emission(channels: Channels, *backward: Callable[[Tensor, Tensor | None, Gradients], None]) -> Emission:
    blended = {name: values for name, values in channels.items() if name != OPACITY_FACTOR}
    factor = channels.get(OPACITY_FACTOR)
    side_by_side = torch.cat(list(blended.values()), -1) if len(blended) > 1 else next(iter(blended.values()))
    widths = {name: values.shape[-1] for name, values in blended.items()}
    return Emission(widths, side_by_side, None if factor is None else factor[:, 0], *backward)
