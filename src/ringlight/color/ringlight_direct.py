"""The RingLight colour model without autograd, for training loops: the same kernels, and less around them.

Only the tables of fields that cannot differentiate them by themselves go through autograd.
"""

from collections.abc import Callable, Mapping
from typing import TYPE_CHECKING

import torch
from jaxtyping import Float
from torch import Tensor

from ringlight import _kernels
from ringlight.color.ring_kernel import Lit, late_light, light_gradients, ring_parameters, shading_layers
from ringlight.core.camera import Camera
from ringlight.core.gaussians import Gaussians
from ringlight.core.gradients import Gradient
from ringlight.core.rendering import OPACITY_FACTOR
from ringlight.fields.ring_tables import RingTables

if TYPE_CHECKING:
    from ringlight.color.ringlight import RingLight

BASE, MASK, LATENTS = "base", "mask_logits", "latents"
"""Columns, see :class:`ringlight.color.ringlight.RingLight`."""

LATE_PAYS = 0.6
"""Share of the visible rows: one that is lit when the blend asks for it takes half again as long as among all of them,
so that this pays where fewer show. Rows that the blend asks for are among the visible ones, see color/drawable.py."""

TABLES = len(("axes", "view", "core"))
"""The first of the kernel's parameters, see :func:`ringlight.color.ring_kernel.ring_parameters`."""


FieldGradients = Callable[[RingTables], dict[str, Tensor]]
"""See :class:`ringlight.fields.contract.LightField`."""


class DirectRingLight:
    """One view at a time: :meth:`draw`, then :meth:`differentiate`."""

    widths: Mapping[str, int] = {"rgb": 3}
    opacity_factor: Float[Tensor, "N"] | None = None
    late: "_kernels.LazyColors | None" = None

    def __init__(self, model: "RingLight"):
        self._model = model
        self._names = {id(parameter): name for name, parameter in model.named_parameters()}
        self._layers = shading_layers(model.shading)
        self._layer_names = [f"color.{self._names[id(layer)]}" for layer in self._layers]
        self._field_gradients: FieldGradients | None = getattr(model.field, "gradients", None)

    def draw(self, gaussians: Gaussians, camera: Camera, may_be_late: bool = False) -> Float[Tensor, "N 3"]:
        """What :meth:`ringlight.color.ringlight.RingLight.channels` calls "rgb", and sets ``opacity_factor``.

        Where it may be late, and the last view hid many rows, sets ``late`` and returns the base colours' logits.
        """
        model, columns = self._model, gaussians.appearance
        self._columns = columns
        self._lit, self.late = bool(model.lit), None
        if MASK in columns:
            self.opacity_factor = torch.empty_like(columns[MASK])
            _kernels.straight_through(columns[MASK], model.settings.mask_threshold, self.opacity_factor[:, None])
        if not self._lit:
            self._color = columns[BASE].sigmoid()
            return self._color
        with torch.set_grad_enabled(self._field_gradients is None):
            tables = model.field.tables()
        assert tables is not None  # else RingLight.direct() gives none of these
        parameters = ring_parameters(tables, model.shading, self._layers)
        self._parameters = parameters.tensors
        rows, values = model.lit_rows(gaussians, camera), [tensor.contiguous() for tensor in self._parameters]
        base, latents = columns[BASE], columns.get(LATENTS, gaussians.means.new_empty(len(gaussians), 0))
        late = may_be_late and model.workspace.many_hidden
        # What is not finite ends a run at once, whether or not it shows; a sum passes it on.
        late = late and bool((base.sum() + latents.sum()).isfinite())
        # Rows that nobody asks for get no gradient: any number will do.
        self._color = torch.zeros_like(base) if late else torch.empty_like(base)
        self._drawn = Lit(rows, parameters.shape, base, latents, values, self._color)
        if late:
            self.late = late_light(rows.means, rows.camera, rows.box, base, latents, parameters, self._color)
            return base
        _kernels.ring_forward(
            parameters.shape, values, rows.means, base, latents, rows.visible, rows.camera, rows.box, self._color
        )
        return self._color

    def differentiate(self, by_channels: Float[Tensor, "N 3"], by_geometry: dict[str, Tensor]) -> dict[str, Gradient]:
        """See :class:`ringlight.color.contract.DirectColor`."""
        gradients: dict[str, Gradient] = {}
        if MASK in self._columns:
            gradients[MASK] = by_mask = torch.empty_like(self._columns[MASK])
            _kernels.straight_through_gradient(self._columns[MASK], by_geometry.pop(OPACITY_FACTOR)[:, None], by_mask)
        if not self._lit:
            return gradients | {BASE: torch.ops.aten.sigmoid_backward(by_channels, self._color)}
        share, workspace = self._model.settings.gradient_share, self._model.workspace
        shown = int(torch.count_nonzero(by_channels[:, 0]))
        workspace.many_hidden = shown < LATE_PAYS * len(self._drawn.rows.visible)
        by_base, by_latents, *by_parameters = light_gradients(self._drawn, by_channels, share, workspace)
        gradients |= {BASE: by_base} | ({LATENTS: by_latents} if LATENTS in self._columns else {})
        return gradients | self._shared(by_parameters)

    def _shared(self, by_parameters: list[Tensor]) -> dict[str, Gradient]:
        """By full name: of what the kernel reads as it is, and through the tables of the field's own parameters."""
        shared: dict[str, Gradient] = dict(zip(self._layer_names, by_parameters[TABLES:], strict=True))
        return shared | self._of_field(by_parameters[:TABLES])

    def _of_field(self, by_tables: list[Tensor]) -> dict[str, Gradient]:
        if self._field_gradients is not None:
            axes, view, core = by_tables
            found = self._field_gradients(RingTables(axes, view, core))
            return {f"color.{self._model.settings.field}.{name}": gradient for name, gradient in found.items()}
        field = self._model.field_parameters()
        by_field = torch.autograd.grad(self._parameters[:TABLES], field, by_tables, allow_unused=True)
        pairs = zip(field, by_field, strict=True)
        return {f"color.{self._names[id(p)]}": gradient for p, gradient in pairs if gradient is not None}
