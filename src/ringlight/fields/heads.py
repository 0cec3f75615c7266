"""The ring's neural heads: networks that make an R x R matrix of a coordinate or of a direction.

A head is a function of one or two numbers only, so it can be run once on fixed nodes and interpolated: a table.
"""

import torch
from jaxtyping import Float
from torch import Tensor, nn

from ringlight.fields.encoding import FourierCode, fourier_features
from ringlight.fields.networks import PerceptronStack
from ringlight.fields.perceptron_kernel import stack_at, stack_gradients
from ringlight.fields.ring_settings import RingSettings
from ringlight.fields.tables import axis_nodes, octahedral_nodes

AXES = 3


def position_code(settings: RingSettings) -> FourierCode:
    """Of a coordinate of a position, or of a channel."""
    return FourierCode(settings.bands, settings.code_pi, settings.code_identity)


def view_code(settings: RingSettings) -> FourierCode:
    """Of a component of a direction."""
    return FourierCode(settings.view_bands, settings.code_pi, settings.code_identity)


class AxisHeads(nn.Module):
    """f_x, f_y and f_z, or some of them: each sees its own coordinate only. D is ``outputs``, or else R^2.

    They are tabulated at ``nodes`` coordinates, by default as many as the settings say.
    """

    nodes: Tensor

    def __init__(
        self,
        settings: RingSettings,
        generator: torch.Generator,
        axes: int = AXES,
        outputs: int | None = None,
        nodes: int | None = None,
    ):
        super().__init__()
        hidden, self.code = settings.head_hidden, position_code(settings)
        widths = (self.code.width(1), hidden, hidden, outputs or settings.rank**2)
        self.networks = PerceptronStack(axes, widths, generator)
        encoded = fourier_features(axis_nodes(nodes or settings.position_nodes)[:, None], self.code)
        self.register_buffer("nodes", encoded.expand(axes, -1, -1).contiguous(), persistent=False)

    def forward(self, points: Float[Tensor, "N A"]) -> Float[Tensor, "A N D"]:
        """The matrices at the coordinates in [-1, 1] of A axes, rows first."""
        return self.networks(fourier_features(points.T[..., None], self.code))

    def table(self) -> Float[Tensor, "A K D"]:
        """The matrices at the K nodes of each axis; no gradient is recorded."""
        return stack_at(self.networks, self.nodes)

    def differentiable_table(self) -> Float[Tensor, "A K D"]:
        """The same by torch."""
        return self.networks(self.nodes)

    def gradients(self, grad_table: Float[Tensor, "A K D"]) -> dict[str, Tensor]:
        """By parameter name, from that of :meth:`table`."""
        return _named(stack_gradients(self.networks, self.nodes, grad_table))


class DirectionHead(nn.Module):
    """f_v: a unit direction to a matrix."""

    nodes: Tensor

    def __init__(self, settings: RingSettings, generator: torch.Generator):
        super().__init__()
        hidden, self.code = settings.head_hidden, view_code(settings)
        widths = (self.code.width(3), hidden, hidden, settings.rank**2)
        self.networks = PerceptronStack(1, widths, generator)
        encoded = fourier_features(octahedral_nodes(settings.view_nodes), self.code)
        self.register_buffer("nodes", encoded[None], persistent=False)

    def forward(self, directions: Float[Tensor, "N 3"]) -> Float[Tensor, "N D"]:
        """The matrices for unit directions, rows first, D = R^2."""
        return self.networks(fourier_features(directions, self.code)[None])[0]

    def table(self) -> Float[Tensor, "K D"]:
        """The matrices at the nodes of the octahedral map, row j * side + i for node (i, j); without a graph."""
        return stack_at(self.networks, self.nodes)[0]

    def differentiable_table(self) -> Float[Tensor, "K D"]:
        """The same by torch."""
        return self.networks(self.nodes)[0]

    def gradients(self, grad_table: Float[Tensor, "K D"]) -> dict[str, Tensor]:
        """By parameter name, from that of :meth:`table`."""
        return _named(stack_gradients(self.networks, self.nodes, grad_table[None]))


class ChannelHead(AxisHeads):
    """f_c of definition 5: a channel's place among all, evenly spaced on [-1, 1], to the D numbers of its core."""

    def __init__(self, settings: RingSettings, generator: torch.Generator, outputs: int):
        super().__init__(settings, generator, 1, outputs, settings.features)

    def cores(self) -> Float[Tensor, "C D"]:
        """Those of all channels; no gradient is recorded."""
        return self.table()[0]

    def differentiable_cores(self) -> Float[Tensor, "C D"]:
        """The same by torch."""
        return self.differentiable_table()[0]


def head_names(**heads: dict[str, Tensor]) -> dict[str, Tensor]:
    """Gradients of several heads' parameters by name in the field that holds them."""
    return {f"{head}.{name}": gradient for head, found in heads.items() for name, gradient in found.items()}


def _named(of_networks: dict[str, Tensor]) -> dict[str, Tensor]:
    return {f"networks.{name}": gradient for name, gradient in of_networks.items()}
