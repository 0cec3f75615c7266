"""How strongly the photographs pull at each Gaussian's place in their pictures: where more are wanted (3DGS, 5.2)."""

from collections.abc import Mapping

import torch
from jaxtyping import Float
from torch import Tensor

from ringlight import _kernels
from ringlight.core.rendering import Rendering
from ringlight.models.splats import SplatModel


class ScreenGradients:
    """Of each row the length of dL/d(NDC position), summed over the views that drew it, and how many these were."""

    def __init__(self) -> None:
        self._sums, self._views = torch.zeros(0), torch.zeros(0)

    def observe(self, model: SplatModel, prediction: Rendering) -> None:
        """Count what a step's picture drew; from zero where the table has other rows than before."""
        if len(self._sums) != len(model):
            self._sums, self._views = torch.zeros(2, len(model), device=model.device)
        self._sums, self._views = self._sums.to(model.device), self._views.to(model.device)
        footprint = prediction.footprint
        if footprint is None or footprint.means2d_gradient is None:
            return
        height, width = prediction.alpha.shape[:2]
        # Half the size in pixels turns a gradient in pixels into one in normalized device coordinates.
        accumulate_screen_gradients_(
            footprint.means2d_gradient, footprint.radii, (width / 2, height / 2), self._sums, self._views
        )

    def means(self) -> Float[Tensor, "N"]:
        """Of each row the mean length over the views that drew it; 0 where none did."""
        return self._sums / self._views.clamp_min(1)

    def clear(self) -> None:
        """The table has other rows now."""
        self._sums, self._views = torch.zeros(0), torch.zeros(0)

    def state(self) -> dict[str, Tensor]:
        """What a resumed run needs."""
        return {"screen_gradients": self._sums, "views": self._views}

    def restore(self, state: Mapping[str, Tensor]) -> None:
        """Inverse of :meth:`state`. Raises ValueError where the two differ in length."""
        if state["screen_gradients"].shape != state["views"].shape:
            raise ValueError(
                f"screen-space gradients for {len(state['screen_gradients'])} rows, and views for {len(state['views'])}"
            )
        self._sums, self._views = state["screen_gradients"].clone(), state["views"].clone()  # moved by the next step


def accumulate_screen_gradients_(
    gradient: Float[Tensor, "N 2"],
    radii: Float[Tensor, "N 2"],
    pixels_to_ndc: tuple[float, float],
    sums: Float[Tensor, "N"],
    views: Float[Tensor, "N"],
) -> None:
    """Add each drawn row's gradient length to ``sums`` and one to ``views``, in place."""
    if not (gradient.is_cpu and gradient.dtype == torch.float32):
        accumulate_screen_gradients_reference_(gradient, radii, pixels_to_ndc, sums, views)
        return
    _kernels.accumulate_screen_gradient(gradient.contiguous(), radii.contiguous(), *pixels_to_ndc, sums, views)


def accumulate_screen_gradients_reference_(
    gradient: Float[Tensor, "N 2"],
    radii: Float[Tensor, "N 2"],
    pixels_to_ndc: tuple[float, float],
    sums: Float[Tensor, "N"],
    views: Float[Tensor, "N"],
) -> None:
    """The same in torch, on any device."""
    drawn = radii[:, 0] > 0
    across, down = pixels_to_ndc
    lengths = torch.hypot(gradient[:, 0] * across, gradient[:, 1] * down)
    sums.add_(torch.where(drawn & lengths.isfinite(), lengths, 0))  # else it would stay for good
    views.add_(drawn)
