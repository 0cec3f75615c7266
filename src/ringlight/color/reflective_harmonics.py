"""What Gaussians emit for a deferred reflection: harmonics as base colour, a normal, and how much they reflect.

3D Gaussian Splatting with Deferred Reflection (Ye et al. 2024, section 4.1): the normal is the shortest axis, turned
towards the camera, so that what moves it is the rotation.
"""

from collections.abc import Mapping, Sequence

import torch
from jaxtyping import Bool
from torch import Tensor, nn

from ringlight import _kernels
from ringlight.color.by_torch import emitted_by_torch
from ringlight.color.contract import Harmonics
from ringlight.color.harmonics import SphericalHarmonics, runs_native, sh_colors
from ringlight.core.camera import Camera
from ringlight.core.directions import shortest_axes
from ringlight.core.gaussians import Gaussians
from ringlight.core.gradients import COLUMNS, Gradients
from ringlight.core.rendering import Channels, Emission
from ringlight.core.scene import PointCloud
from ringlight.core.sh_basis import MAX_DEGREE
from ringlight.core.want import Want

STRENGTHS = "reflection_logits"

FIRST_STRENGTH = 1e-3
"""Share of the reflection in a Gaussian's colour at the start, as in 3DGS-DR: too little to see, yet it learns."""

SHORTEST_QUATERNION = 1e-12
"""As torch's normalize has it: shorter ones are not stretched to unit length."""


class ReflectiveHarmonics(nn.Module):
    """Columns: those of :class:`SphericalHarmonics`, and "reflection_logits" [N], of the strength in (0, 1).

    Emits "rgb", the base colour, clamped at black, "normal", unit, world, towards the camera, and "reflection", the
    strength. New Gaussians reflect ``first_strength`` of their light, in (0, 1).
    """

    emits: Mapping[str, int] = {"rgb": 3, "normal": 3, "reflection": 1}
    training_columns: tuple[str, ...] = ()
    opacity_columns: tuple[str, ...] = ()
    axes_are_normals: bool = True

    def __init__(self, degree: int = MAX_DEGREE, first_strength: float = FIRST_STRENGTH):
        super().__init__()
        self.harmonic = SphericalHarmonics(degree)
        self.first_strength = first_strength

    def new_columns(self, points: PointCloud) -> dict[str, Tensor]:
        """The points' colours from every side, and the first strength."""
        strengths = torch.full((len(points.colors),), self.first_strength).logit()
        return self.harmonic.new_columns(points) | {STRENGTHS: strengths.to(points.colors)}

    def emit(self, gaussians: Gaussians, camera: Camera, names: Sequence[str], want: Want) -> Emission:
        """All channels; "rgb" alone where nothing else is asked for."""
        if list(names) == ["rgb"]:
            return self.harmonic.emit(gaussians, camera, names, want)
        table, degree = gaussians.columns(), int(self.harmonic.active_degree)
        if runs_native(*table.values()):
            return self._native_emission(gaussians, camera, want)

        def channels(columns: dict[str, Tensor]) -> Channels:
            colors = sh_colors(columns["means"], columns["sh_dc"], columns["sh_rest"], camera.position, degree)
            return {"rgb": colors} | surface_channels_reference(columns, camera)

        return emitted_by_torch(channels, table, {}, want)

    @torch.no_grad()
    def _native_emission(self, gaussians: Gaussians, camera: Camera, want: Want) -> Emission:
        base = self.harmonic.emit(gaussians, camera, ("rgb",), want)
        strengths = gaussians.appearance[STRENGTHS]
        rows = (gaussians.means, gaussians.log_scales, gaussians.quats, strengths, camera.native, SHORTEST_QUATERNION)
        channels = base.channels.new_empty(len(gaussians), sum(self.emits.values()))
        _kernels.surface_channels(*rows, base.channels, channels)
        if want is not Want.GRADIENTS:
            return Emission(self.emits, channels)

        @torch.no_grad()
        def backward(grad_channels: Tensor, _: Tensor | None, into: Gradients) -> None:
            of_colors, of_quats, of_strengths = (
                torch.empty_like(tensor) for tensor in (base.channels, gaussians.quats, strengths)
            )
            _kernels.surface_gradient(*rows, grad_channels.contiguous(), of_colors, of_quats, of_strengths)
            into.add(COLUMNS + "quats", of_quats)
            into.add(COLUMNS + STRENGTHS, of_strengths)
            base.backward(of_colors, None, into)

        return Emission(self.emits, channels, backward=backward)

    @torch.no_grad()
    def layers(self, gaussians: Gaussians, camera: Camera) -> Channels:
        """ "base" [N 3], towards the camera, and "reflection" [N 1], the strength."""
        base = self.harmonic.emit(gaussians, camera, ("rgb",), Want.EXACT).channels
        return {"base": base, "reflection": gaussians.appearance[STRENGTHS].sigmoid()[:, None]}

    def features(self, gaussians: Gaussians, camera: Camera) -> None:
        """None: harmonics are no network."""

    def wanted(self, gaussians: Gaussians) -> Bool[Tensor, "N"]:
        """Every row is shown."""
        return self.harmonic.wanted(gaussians)

    def harmonics(self, gaussians: Gaussians) -> Harmonics:
        """The base colours; whether they are what is seen, the shader knows."""
        return self.harmonic.harmonics(gaussians)


def surface_channels_reference(columns: Mapping[str, Tensor], camera: Camera) -> Channels:
    """Normal and strength in torch and in any precision, from the columns by name."""
    table = Gaussians.from_columns(columns)
    return {
        "normal": shortest_axes(table, camera.position.to(table.means)),
        "reflection": columns[STRENGTHS].sigmoid()[:, None],
    }
