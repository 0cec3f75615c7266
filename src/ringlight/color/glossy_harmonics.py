"""Harmonics as colour, and an opacity of harmonics too: what Gaussians of Glossy-Gaussian emit (Zhang et al. 2025).

The constant harmonic of the opacity is in the table as every Gaussian's opacity is, as a logit: opacity = 0.5 + C0 c is
the mean over all directions, and what looks at opacities (density control, files, other programs) sees that. The others
are added as they are, without a sigmoid:

    opacity(v) = clamp(sigmoid(logit) + sum over k = 1..15 of c_k Y_k(v), 0, 1)
"""

from collections.abc import Mapping, Sequence

import torch
from jaxtyping import Bool, Float
from torch import Tensor, nn

from ringlight import _kernels
from ringlight.color.by_torch import OPACITY_FACTOR, emitted_by_torch
from ringlight.color.contract import Harmonics
from ringlight.color.harmonics import SphericalHarmonics, runs_native, sh_colors
from ringlight.core.camera import Camera
from ringlight.core.directions import view_directions
from ringlight.core.gaussians import Gaussians
from ringlight.core.gradients import COLUMNS, Gradients, dense
from ringlight.core.rendering import Channels, Emission
from ringlight.core.scene import PointCloud
from ringlight.core.sh_basis import MAX_DEGREE, basis_count, sh_basis
from ringlight.core.want import Want
from ringlight.errors import RecipeError

OPACITY_REST = "opacity_rest"

LEAST_MEAN = 1e-12
"""Mean opacity from which on the opacity towards a camera is exact; of what is fainter it falls with the mean, so that
a factor on the mean stays a number."""


class GlossyHarmonics(nn.Module):
    """Columns: those of :class:`SphericalHarmonics`, and "opacity_rest" [N K], the opacity's harmonics after the
    constant one up to ``opacity_degree``, in units of opacity: K is 0, 3, 8 or 15.

    ``active_opacity_degree`` grows during training as that of the colours does, ``harmonic.active_degree``.
    """

    active_opacity_degree: Tensor
    emits: Mapping[str, int] = {"rgb": 3}
    training_columns: tuple[str, ...] = ()
    opacity_columns: tuple[str, ...] = (OPACITY_REST,)
    axes_are_normals: bool = False

    def __init__(self, degree: int = MAX_DEGREE, opacity_degree: int = MAX_DEGREE):
        super().__init__()
        if not 0 <= opacity_degree <= MAX_DEGREE:
            raise RecipeError(f"the degree of the opacity's harmonics is {opacity_degree}; give 0 to {MAX_DEGREE}")
        self.harmonic = SphericalHarmonics(degree)
        self.opacity_degree = opacity_degree
        self.register_buffer("active_opacity_degree", torch.tensor(opacity_degree))
        self.register_load_state_dict_post_hook(_refuse_other_degrees)

    def new_columns(self, points: PointCloud) -> dict[str, Tensor]:
        """The points' colours, and the same opacity from every side."""
        rest = torch.zeros(len(points.colors), basis_count(self.opacity_degree) - 1)
        return self.harmonic.new_columns(points) | {OPACITY_REST: rest}

    def emit(self, gaussians: Gaussians, camera: Camera, names: Sequence[str], want: Want) -> Emission:
        """ "rgb" [N 3], clamped at black, and the opacity factor once the opacity's degree is above 0."""
        degree, columns = int(self.active_opacity_degree), gaussians.columns()
        if not degree:
            return self.harmonic.emit(gaussians, camera, names, want)
        if runs_native(*columns.values()):
            return self._native_emission(gaussians, camera, degree, want)
        degree_of_colors = int(self.harmonic.active_degree)

        def channels(columns: dict[str, Tensor]) -> Channels:
            means, logits, rest = (columns[name] for name in ("means", "opacity_logits", OPACITY_REST))
            colors = sh_colors(means, columns["sh_dc"], columns["sh_rest"], camera.position, degree_of_colors)
            factors = opacity_factors_reference(means, logits, rest, camera.position, degree)
            return {"rgb": colors, OPACITY_FACTOR: factors[:, None]}

        read = {name: columns[name] for name in ("means", "opacity_logits", *gaussians.appearance)}
        return emitted_by_torch(channels, read, {}, want)

    @torch.no_grad()
    def _native_emission(self, gaussians: Gaussians, camera: Camera, degree: int, want: Want) -> Emission:
        base = self.harmonic.emit(gaussians, camera, ("rgb",), want)
        rest, logits = gaussians.appearance[OPACITY_REST], gaussians.opacity_logits
        rows = (gaussians.means, logits, rest, camera.native, degree, LEAST_MEAN)
        factors = torch.empty_like(logits)
        _kernels.sh_opacity_factors(*rows, factors)
        if want is not Want.GRADIENTS:
            return Emission(base.widths, base.channels, factors)

        @torch.no_grad()
        def backward(grad_channels: Tensor, grad_factors: Tensor | None, into: Gradients) -> None:
            base.backward(grad_channels, None, into)
            if grad_factors is None:
                return
            known, grad_rest = into.get(COLUMNS + "opacity_logits"), torch.empty_like(rest)
            grad_means = dense(into[COLUMNS + "means"])
            grad_logits = torch.zeros_like(logits) if known is None else dense(known)
            _kernels.sh_opacity_gradient(*rows, grad_factors.contiguous(), grad_means, grad_logits, grad_rest)
            into |= {COLUMNS + "means": grad_means, COLUMNS + "opacity_logits": grad_logits}
            into.add(COLUMNS + OPACITY_REST, grad_rest)

        return Emission(base.widths, base.channels, factors, backward)

    def layers(self, gaussians: Gaussians, camera: Camera) -> Channels:
        """The colour without a view, and what the view adds (signed); both as opaque as they are towards the camera."""
        return self.harmonic.layers(gaussians, camera)

    def features(self, gaussians: Gaussians, camera: Camera) -> None:
        """None: harmonics are no network."""

    def wanted(self, gaussians: Gaussians) -> Bool[Tensor, "N"]:
        """Every row is shown."""
        return self.harmonic.wanted(gaussians)

    def harmonics(self, gaussians: Gaussians) -> Harmonics:
        """Of the colours; that the opacity depends on the camera, the emission's factor says."""
        return self.harmonic.harmonics(gaussians)


def _refuse_other_degrees(model: GlossyHarmonics, _: object) -> None:
    """Files hold the degree as a number: ValueError for one whose harmonics are not stored."""
    degree = int(model.active_opacity_degree)
    if not 0 <= degree <= model.opacity_degree:
        raise ValueError(f"active_opacity_degree is {degree}, not 0 to {model.opacity_degree}")


def opacity_factors_reference(
    means: Float[Tensor, "N 3"],
    logits: Float[Tensor, "N"],
    rest: Float[Tensor, "N K"],
    position: Float[Tensor, "3"],
    degree: int,
) -> Float[Tensor, "N"]:
    """What the kernels compute, in any float dtype: the opacity towards a camera at ``position`` over its mean."""
    basis = sh_basis(view_directions(means, position.to(means)), degree)[:, 1:]
    mean = logits.sigmoid()
    return (mean + (basis * rest[:, : basis.shape[1]]).sum(-1)).clamp(0, 1) / mean.clamp_min(LEAST_MEAN)
