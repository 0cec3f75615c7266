"""The kernel of 3iGS's light: from Gaussians in a view to what the field and the network add, and back."""

from dataclasses import dataclass

import torch
from jaxtyping import Float, Int, Int32
from torch import Tensor

from ringlight import _kernels
from ringlight.core.camera import Camera
from ringlight.core.directions import SMALLEST_LENGTH
from ringlight.core.gaussians import Gaussians
from ringlight.fields.directional_encoding import kernel_polynomials
from ringlight.fields.illumination import Illumination
from ringlight.fields.networks import PerceptronStack
from ringlight.fields.perceptron_kernel import stack_parameter_names, stack_parameters

ROUGHNESS, FEATURES = "roughness", "features"

ROUGHNESS_SHIFT = 1.0
"""Roughness is softplus(stored - 1), as in Ref-NeRF and 3iGS."""


@dataclass(frozen=True)
class LitView:
    """Gaussians of one view that are lit, and by what. Parameters must not change until the way back has gone."""

    job: _kernels.IlluminatedJob
    rows: Int[Tensor, "V"]
    field: Illumination
    network: PerceptronStack
    columns: dict[str, Tensor]


def lit_view(
    field: Illumination,
    network: PerceptronStack,
    gaussians: Gaussians,
    rows: Int32[Tensor, "V"],
    camera: Camera,
    box: Float[Tensor, "2 3"],
) -> LitView:
    """``box`` are the corners of what the field covers, world units. All tensors are float32 on the CPU."""
    columns = {name: gaussians.appearance[name].detach().contiguous() for name in (ROUGHNESS, FEATURES)}
    grids = [[grid.contiguous() for grid in grids.detach().unbind()] for grids in (field.planes, field.lines)]
    job = _kernels.IlluminatedJob(
        planes=grids[0],
        lines=grids[1],
        mix=field.mix.detach().contiguous(),
        offset=field.offset.detach().contiguous(),
        parameters=stack_parameters(network),
        polynomials=kernel_polynomials(),
        means=gaussians.means.detach().contiguous(),
        roughness=columns[ROUGHNESS],
        features=columns[FEATURES],
        rows=rows,
        low=box[0].tolist(),
        scale=(2 / (box[1] - box[0])).tolist(),
        position=camera.position.tolist(),
        smallest_length=SMALLEST_LENGTH,
        roughness_shift=ROUGHNESS_SHIFT,
    )
    return LitView(job, rows.long(), field, network, columns)


def illuminated_specular(view: LitView) -> Float[Tensor, "V 3"]:
    """What the light adds to each lit row's colour, in [-1, 1]."""
    specular = view.columns[ROUGHNESS].new_empty(len(view.rows), 3)
    _kernels.illuminated_forward(view.job, specular)
    return specular


def illuminated_gradients(
    view: LitView, upstream: Float[Tensor, "V 3"], share: float
) -> tuple[dict[str, Tensor], dict[str, Tensor]]:
    """By the columns and by the field's and the network's parameters, of at most a ``share`` of the rows, drawn by
    importance (``core/importance_sampling.py``). Empty where no row has a gradient."""
    of_columns = {name: torch.zeros_like(column) for name, column in view.columns.items()}
    of_field = {name: torch.empty_like(parameter) for name, parameter in view.field.named_parameters()}
    of_network = [torch.empty_like(parameter) for parameter in stack_parameters(view.network)]
    drawn = _kernels.illuminated_backward(
        view.job,
        upstream.contiguous(),
        share,
        of_roughness=of_columns[ROUGHNESS],
        of_features=of_columns[FEATURES],
        of_parameters=of_network,
        of_mix=of_field["mix"],
        of_offset=of_field["offset"],
        of_planes=list(of_field["planes"].unbind()),
        of_lines=list(of_field["lines"].unbind()),
    )
    if not drawn:
        return {}, {}
    of_color = {f"field.{name}": gradient for name, gradient in of_field.items()}
    of_color |= {
        f"network.{name}": gradient for name, gradient in zip(stack_parameter_names(), of_network, strict=True)
    }
    return of_columns, of_color
