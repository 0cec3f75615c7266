"""Spherical harmonics per Gaussian: the colour of 3DGS (Kerbl et al. 2023, section 5 and appendix)."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import torch
from jaxtyping import Bool, Float
from torch import Tensor, nn

from ringlight import _kernels
from ringlight.color.by_torch import emitted_by_torch
from ringlight.color.contract import Harmonics
from ringlight.core.camera import Camera
from ringlight.core.directions import view_directions
from ringlight.core.gaussians import Gaussians
from ringlight.core.gradients import COLUMNS, AdamStep, Gradients, dense
from ringlight.core.rendering import Channels, Emission
from ringlight.core.scene import DARKEST, PointCloud
from ringlight.core.sh_basis import C0, GREY, MAX_DEGREE, basis_count, rgb_from_sh, sh_basis, sh_from_rgb
from ringlight.core.triton_kernels import runs_triton
from ringlight.core.want import Want
from ringlight.errors import RecipeError

SH_COLUMNS = ("sh_dc", "sh_rest")


class SphericalHarmonics(nn.Module):
    """Columns "sh_dc" [N 3], the constant coefficient, and "sh_rest" [N K 3], the others up to ``degree``, so that each
    has its own rate: K is 0, 3, 8 or 15.

    ``active_degree`` grows during training (3DGS: one per 1,000 steps); it is saved with the model and stays on the
    CPU. Harmonics above it are neither read nor given a gradient.
    """

    active_degree: Tensor
    emits: Mapping[str, int] = {"rgb": 3}
    training_columns: tuple[str, ...] = ()
    opacity_columns: tuple[str, ...] = ()
    axes_are_normals: bool = False

    def __init__(self, degree: int = MAX_DEGREE):
        super().__init__()
        if not 0 <= degree <= MAX_DEGREE:
            raise RecipeError(f"sh_degree is {degree}; give 0 to {MAX_DEGREE}")
        self.degree = degree
        self.register_buffer("active_degree", torch.tensor(degree))
        self.register_load_state_dict_post_hook(_refuse_other_degrees)

    def new_columns(self, points: PointCloud) -> dict[str, Tensor]:
        """The points' own colours, the same from every side; no channel starts at black, where it would not learn."""
        rest = torch.zeros(len(points.colors), basis_count(self.degree) - 1, 3)
        return {"sh_dc": sh_from_rgb(points.colors.clamp_min(DARKEST)), "sh_rest": rest}

    def emit(self, gaussians: Gaussians, camera: Camera, names: Sequence[str], want: Want) -> Emission:
        """ "rgb" [N 3], clamped at black."""
        columns = {"means": gaussians.means, **{name: gaussians.appearance[name] for name in SH_COLUMNS}}
        degree = int(self.active_degree)
        if runs_native(*columns.values()):
            return _native_emission(columns, camera.native, degree, want)

        def colors(columns: dict[str, Tensor]) -> Channels:
            means, dc, rest = columns.values()
            return {"rgb": sh_colors(means, dc, rest, camera.position, degree)}

        return emitted_by_torch(colors, columns, {}, want)

    def layers(self, gaussians: Gaussians, camera: Camera) -> Channels:
        """The colour without a view, and what the view adds (signed)."""
        base = rgb_from_sh(gaussians.appearance["sh_dc"]).clamp_min(0)
        shown = self.emit(gaussians, camera, ("rgb",), Want.EXACT).channels
        return {"base": base, "residual": shown - base}

    def features(self, gaussians: Gaussians, camera: Camera) -> None:
        """None: harmonics are no network."""

    def wanted(self, gaussians: Gaussians) -> Bool[Tensor, "N"]:
        """Every row is shown."""
        return torch.ones(len(gaussians), dtype=torch.bool, device=gaussians.means.device)

    def harmonics(self, gaussians: Gaussians) -> Harmonics:
        """The columns; coefficients above the active degree are zero."""
        dc, rest = (gaussians.appearance[name] for name in SH_COLUMNS)
        return Harmonics(dc, rest)


def _refuse_other_degrees(harmonics: SphericalHarmonics, _: object) -> None:
    """Files hold the degree as a number: ValueError for one whose harmonics are not stored."""
    degree = int(harmonics.active_degree)
    if not 0 <= degree <= harmonics.degree:
        raise ValueError(f"active_degree is {degree}, not 0 to {harmonics.degree}")


def sh_colors_reference(
    means: Float[Tensor, "N 3"],
    dc: Float[Tensor, "N 3"],
    rest: Float[Tensor, "N K 3"],
    position: Float[Tensor, "3"],
    degree: int,
) -> Float[Tensor, "N 3"]:
    """What the kernels compute, in any float dtype: colour towards a camera at ``position``, clamped at black."""
    basis = sh_basis(view_directions(means, position.to(means)), degree)[:, 1:]
    seen = torch.einsum("nk,nkc->nc", basis, rest[:, : basis.shape[1]])
    return (GREY + C0 * dc + seen).clamp_min(0)


def sh_colors(
    means: Float[Tensor, "N 3"],
    dc: Float[Tensor, "N 3"],
    rest: Float[Tensor, "N K 3"],
    position: Float[Tensor, "3"],
    degree: int,
) -> Float[Tensor, "N 3"]:
    """The same by torch's autograd; on a GPU by Triton's kernels."""
    if not runs_triton(means, dc, rest):
        return sh_colors_reference(means, dc, rest, position, degree)
    from ringlight.color.harmonics_triton import sh_colors_by_triton

    return sh_colors_by_triton(means, dc, rest, position, degree)


def runs_native(*tensors: Tensor) -> bool:
    """Whether the compiled kernels take these tensors."""
    return all(tensor.dtype == torch.float32 and tensor.is_cpu and tensor.is_contiguous() for tensor in tensors)


def _native_emission(columns: dict[str, Tensor], camera: _kernels.Camera, degree: int, want: Want) -> Emission:
    means, dc, rest = columns.values()
    colors = torch.empty_like(means)
    factors = means.new_empty(_kernels.sh_slopes(len(means))) if want is Want.GRADIENTS else None
    _kernels.sh_colors(means, dc, rest, camera, degree, colors, factors)
    if factors is None:
        return Emission({"rgb": 3}, colors)

    def backward(grad_channels: Tensor, _: Tensor | None, into: Gradients) -> None:
        grad_dc, known = torch.empty_like(colors), into.get(COLUMNS + "means")
        grad_means = torch.empty_like(means) if known is None else dense(known)
        _kernels.sh_gradient(grad_channels, colors, factors, grad_means, grad_dc, known is not None)
        into[COLUMNS + "means"] = grad_means
        into.add(COLUMNS + "sh_dc", grad_dc)
        into.add(COLUMNS + "sh_rest", RestGradient(means, camera, degree, grad_dc, rest.shape[1]))

    return Emission({"rgb": 3}, colors, backward=backward)


@dataclass(frozen=True)
class RestGradient:
    """dL/d(sh_rest) as it comes: the harmonics' values, made anew from means and camera, times dL/d(sh_dc)."""

    means: Float[Tensor, "N 3"]
    camera: _kernels.Camera
    degree: int
    grad_dc: Float[Tensor, "N 3"]
    stored: int
    """K: harmonics a row holds, those above the degree included."""

    def dense(self) -> Float[Tensor, "N K 3"]:
        """Written down; zero above the degree."""
        grad_rest = self.means.new_empty(len(self.means), self.stored, 3)
        _kernels.sh_rest_gradient(self.means, self.camera, self.degree, self.grad_dc, grad_rest)
        return grad_rest

    def adam_(self, value: Tensor, mean: Tensor, square: Tensor, step: AdamStep) -> int:
        """One update with :meth:`dense`, which is never written. Harmonics that were never in use are left alone."""
        return _kernels.sh_rest_adam(self.means, self.camera, self.degree, self.grad_dc, value, mean, square, step)
