"""What the ring's kernel makes every Gaussian emit, and its way back."""

from typing import TYPE_CHECKING

import torch
from jaxtyping import Float
from torch import Tensor

from ringlight import _kernels
from ringlight.color.ring_kernel import Lit, lazy_light, light_gradients, ring_parameters
from ringlight.color.visibility_mask import mask_factor, mask_gradient
from ringlight.core.camera import Camera
from ringlight.core.gaussians import Gaussians
from ringlight.core.gradients import COLOR, COLUMNS, Gradients
from ringlight.core.rendering import Emission, LazyColors
from ringlight.core.want import Want
from ringlight.fields.ring_tables import RingTables

if TYPE_CHECKING:
    from ringlight.color.ringlight import RingLight

BASE, MASK, LATENTS = "base", "mask_logits", "latents"
"""Columns, see :class:`ringlight.color.ringlight.RingLight`."""

LAZY_PAYS = 0.6
"""Share of the visible rows: one that is lit when the blend asks for it takes half again as long as among all of them,
so that this pays where fewer show. Rows that the blend asks for are among the visible ones, see color/drawable.py."""


@torch.no_grad()
def base_emission(model: "RingLight", gaussians: Gaussians, want: Want) -> Emission:
    """Before the field is lit: the base colours."""
    columns = gaussians.appearance
    colors, factor = model.base(gaussians).sigmoid(), _factor(model, gaussians)
    if want is not Want.GRADIENTS:
        return Emission(model.emits, colors, factor)

    @torch.no_grad()
    def backward(grad_channels: Tensor, grad_factor: Tensor | None, into: Gradients) -> None:
        _add_mask_gradient(columns, grad_factor, into)
        if BASE in columns:
            into.add(COLUMNS + BASE, torch.ops.aten.sigmoid_backward(grad_channels, colors))

    return Emission(model.emits, colors, factor, backward)


@torch.no_grad()
def ring_emission(model: "RingLight", gaussians: Gaussians, camera: Camera, tables: RingTables, want: Want) -> Emission:
    """Lazily where a picture is wanted, or where the view of the step before hid many rows: the same bits."""
    base, latents, factor = model.base(gaussians), model.latents(gaussians), _factor(model, gaussians)
    parameters = ring_parameters(tables, model.shading, model.layers_of_shading)
    if want is Want.PICTURE:
        kernel = lazy_light(gaussians.means, camera.native, model.box, base, latents, parameters)
        lazy = LazyColors(base, kernel, lambda: ring_emission(model, gaussians, camera, tables, Want.EXACT).channels)
        return Emission(model.emits, lazy, factor)
    values = [tensor.contiguous() for tensor in parameters.tensors]
    rows, lazily = model.lit_rows(gaussians, camera), want is Want.GRADIENTS and _pays(model, base, latents)
    # Rows that nobody asks for get no gradient: any number will do.
    color = torch.zeros_like(base) if lazily else torch.empty_like(base)
    lit = Lit(rows, parameters.shape, base, latents, values, color)

    def all_rows() -> Tensor:
        _kernels.ring_forward(
            parameters.shape, values, rows.means, base, latents, rows.visible, rows.camera, rows.box, color
        )
        return color

    if want is not Want.GRADIENTS:
        return Emission(model.emits, all_rows(), factor)
    back = _WayBack(model, gaussians, lit, tables)
    if not lazily:
        return Emission(model.emits, all_rows(), factor, back)
    kernel = lazy_light(rows.means, rows.camera, rows.box, base, latents, parameters, color)
    return Emission(model.emits, LazyColors(base, kernel, all_rows), factor, back)


@torch.no_grad()
def gained_emission(model: "RingLight", gaussians: Gaussians, colors: Float[Tensor, "N 3"]) -> Emission:
    """Of a model whose residual was edited, without a way back: all ``colors``, made already."""
    return Emission(model.emits, colors, _factor(model, gaussians))


def _pays(model: "RingLight", base: Tensor, latents: Tensor) -> bool:
    """What is not finite ends a run at once, whether or not it shows; a sum passes it on."""
    return model.workspace.many_hidden and bool((base.sum() + latents.sum()).isfinite())


def _factor(model: "RingLight", gaussians: Gaussians) -> Float[Tensor, "N"] | None:
    if MASK not in gaussians.appearance:
        return None
    return mask_factor(gaussians.appearance[MASK], model.settings.mask_threshold)


def _add_mask_gradient(columns: dict[str, Tensor], grad_factor: Tensor | None, into: Gradients) -> None:
    if MASK in columns and grad_factor is not None:
        into.add(COLUMNS + MASK, mask_gradient(columns[MASK], grad_factor))


class _WayBack:
    """See :class:`ringlight.core.rendering.Emission`; positions and directions get no gradient."""

    def __init__(self, model: "RingLight", gaussians: Gaussians, lit: Lit, tables: RingTables):
        self._model, self._columns, self._lit, self._tables = model, gaussians.appearance, lit, tables

    @torch.no_grad()
    def __call__(self, grad_channels: Float[Tensor, "N 3"], grad_factor: Tensor | None, into: Gradients) -> None:
        model, columns = self._model, self._columns
        _add_mask_gradient(columns, grad_factor, into)
        shown = int(torch.count_nonzero(grad_channels[:, 0]))
        model.workspace.many_hidden = shown < LAZY_PAYS * len(self._lit.rows.visible)
        found = light_gradients(self._lit, grad_channels, model.settings.gradient_share, model.workspace)
        grad_base, grad_latents, axes, view, core, *of_layers = found
        for name, gradient in ((BASE, grad_base), (LATENTS, grad_latents)):
            if name in columns:
                into.add(COLUMNS + name, gradient)
        names = (COLOR + name for name in model.names_of_shading)
        into.add_all(dict(zip(names, of_layers, strict=True)))
        of_field = self._tables.backward(RingTables(axes, view, core, self._tables.diagonal))
        into.add_all({f"{COLOR}{model.settings.field}.{name}": gradient for name, gradient in of_field.items()})
