"""The fused light-field kernel: tables and weights in, colours out, nothing kept in between."""

from dataclasses import dataclass

import torch
from jaxtyping import Float, Int32
from torch import Tensor

from ringlight import _kernels
from ringlight.color.render_module import LitColor, RenderModule
from ringlight.core.kernel_limits import RING_MAX_FEATURES, RING_MAX_HIDDEN, RING_MAX_NODES, RING_MAX_RANK
from ringlight.fields.ring_tables import RingTables

# Weights and biases of the light modulation's two layers.
MODULATION = 4


@dataclass(frozen=True)
class LitRows:
    """Which Gaussians are lit, and from where.

    ``visible`` numbers the rows that the light field reaches; the others show their base colour. ``box`` has the low
    and the high corner of what the ring covers, world units.
    """

    means: Float[Tensor, "N 3"]
    visible: Int32[Tensor, "V"]
    camera: _kernels.Camera
    box: Float[Tensor, "2 3"]


@dataclass(frozen=True)
class RingParameters:
    """What the kernel needs of a model, the tensors in its order."""

    shape: _kernels.RingShape
    tensors: list[Tensor]


def kernel_takes(tables: RingTables, layers: list[Tensor], means: Tensor) -> bool:
    """Whether the kernel can do it: float32 on the CPU, and no size beyond its limits."""
    widest = max(len(layer) for layer in layers)
    fits = (
        tables.axes.shape[-1] <= RING_MAX_RANK**2
        and len(tables.core) <= RING_MAX_FEATURES
        and widest <= RING_MAX_HIDDEN
    )
    fits = fits and tables.axes.shape[1] <= RING_MAX_NODES and len(tables.view) <= RING_MAX_NODES**2
    kinds = {(tensor.dtype, tensor.device.type) for tensor in (tables.axes, tables.core, means)}
    return fits and kinds == {(torch.float32, "cpu")}


def shading_layers(shading: RenderModule) -> list[Tensor]:
    """Weight and bias of each layer, as the kernel wants them after the tables; finding them takes torch a while."""
    modulation = [] if shading.modulation is None else list(shading.modulation.parameters())
    return [*modulation, *shading.render.parameters()]


def ring_parameters(tables: RingTables, shading: RenderModule, layers: list[Tensor]) -> RingParameters:
    """Gathers tables and :func:`shading_layers`; the order is that of ``parameters_from`` in bind_ring.cpp."""
    nodes, matrix = tables.axes.shape[1:]
    modulation_hidden = 0 if shading.modulation is None else len(layers[0])
    render_hidden = len(layers[0 if shading.modulation is None else MODULATION])
    shape = _kernels.RingShape(
        rank=round(matrix**0.5),
        features=len(tables.core),
        render_hidden=render_hidden,
        modulation_hidden=modulation_hidden,
        nodes=nodes,
        view_nodes=round(len(tables.view) ** 0.5),
        latents=shading.latents,
        diagonal=tables.diagonal,
        factor=shading.weighs,
        clamped=shading.clamps,
    )
    return RingParameters(shape, [tables.axes, tables.view, tables.core, *layers])


class Workspace:
    """Memory for the backward pass that outlives a step: tens of megabytes that the system would clear every time.

    ``many_hidden`` says whether the last step's view hid so many rows that colours had better be lazy; a matter of
    time alone.
    """

    def __init__(self) -> None:
        self.many_hidden = False
        self._floats = torch.empty(0, dtype=torch.float32, device="cpu")

    def floats(self, count: int) -> Float[Tensor, "K"]:
        """At least ``count`` floats of any content; valid until the next call."""
        if len(self._floats) < count:
            self._floats = self._floats.new_empty(count)
        return self._floats


@dataclass(frozen=True)
class Lit:
    """What the forward pass was given, and the colours that it made."""

    rows: LitRows
    shape: _kernels.RingShape
    base: Float[Tensor, "N 3"]
    latents: Float[Tensor, "N L"]
    parameters: list[Tensor]
    color: Float[Tensor, "N 3"]


def light_gradients(lit: Lit, grad_color: Float[Tensor, "N 3"], share: float, workspace: Workspace) -> list[Tensor]:
    """Gradients of the base colours' logits, of the latents and of each parameter, in this order.

    The same bits for any number of threads. The gradient of rows whose colour got none is not computed; of the others
    at most ``share`` are expected to be, see ``core/importance_sampling.py``.
    """
    rows, leaves = lit.rows, [lit.base, lit.latents, *lit.parameters]
    grad_base, grad_latents, *grad_parameters = gradients = [torch.empty_like(leaf) for leaf in leaves]
    floats = workspace.floats(_kernels.ring_workspace(lit.shape, len(rows.visible)))
    _kernels.ring_backward(
        lit.shape, lit.parameters, rows.means, lit.base, lit.latents, rows.visible, rows.camera, rows.box,
        lit.color, grad_color, share, grad_parameters, grad_base, grad_latents, floats,
    )  # fmt: skip
    return gradients


@torch.no_grad()
def light_layers(
    rows: LitRows, base: Float[Tensor, "N 3"], latents: Float[Tensor, "N L"], parameters: RingParameters
) -> LitColor:
    """Colour, residual and modulation without gradient; the last two are zero in rows that are not lit."""
    tensors = [tensor.detach().contiguous() for tensor in parameters.tensors]
    color, residual, modulation = torch.empty_like(base), torch.zeros_like(base), torch.zeros_like(base[:, :1])
    _kernels.ring_forward(
        parameters.shape, tensors, rows.means, base.detach().contiguous(), latents.detach().contiguous(),
        rows.visible, rows.camera, rows.box, color, residual, modulation,
    )  # fmt: skip
    return LitColor(color, residual, modulation)


@torch.no_grad()
def lazy_light(
    means: Float[Tensor, "N 3"],
    camera: _kernels.Camera,
    box: Float[Tensor, "2 3"],
    base: Float[Tensor, "N 3"],
    latents: Float[Tensor, "N L"],
    parameters: RingParameters,
    colors: Float[Tensor, "N 3"] | None = None,
) -> "_kernels.LazyRing":
    """The colours for a rasterizer that asks for them row by row; ``box`` as in :class:`LitRows`.

    With ``colors``, where those that were asked for are left, a backward pass may follow.
    """
    tensors = [tensor.detach().contiguous() for tensor in parameters.tensors]
    means, base, latents = (column.detach().contiguous() for column in (means, base, latents))
    return _kernels.LazyRing(parameters.shape, tensors, means, base, latents, camera, box, colors)
