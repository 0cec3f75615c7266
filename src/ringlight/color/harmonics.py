"""Spherical harmonics per Gaussian: the colour of 3DGS (Kerbl et al. 2023, section 5 and appendix)."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import torch
from jaxtyping import Bool, Float
from torch import Tensor, nn
from torch.autograd.function import once_differentiable

from ringlight.core.camera import Camera
from ringlight.core.directions import view_directions
from ringlight.core.gaussians import Gaussians
from ringlight.core.gradients import AdamStep, Gradient
from ringlight.core.rendering import Channels
from ringlight.core.scene import PointCloud
from ringlight.core.sh_basis import C0, GREY, MAX_DEGREE, basis_count, rgb_from_sh, sh_basis, sh_from_rgb
from ringlight.core.triton_kernels import runs_triton
from ringlight.errors import RecipeError

try:
    from ringlight import _kernels
except ImportError:
    _kernels = None  # type: ignore[assignment]

REST_COUNT = basis_count(MAX_DEGREE) - 1


class SphericalHarmonics(nn.Module):
    """Columns "sh_dc" [N 3], the constant coefficient, and "sh_rest" [N 15 3], so that each has its own rate.

    ``active_degree`` grows during training (3DGS: one per 1,000 steps); it is saved with the model and stays on the
    CPU. Harmonics above it are neither read nor given a gradient.
    """

    active_degree: Tensor
    training_columns: tuple[str, ...] = ()

    def __init__(self, degree: int = MAX_DEGREE):
        super().__init__()
        if not 0 <= degree <= MAX_DEGREE:
            raise RecipeError(f"the degree of the spherical harmonics is {degree}; give 0 to {MAX_DEGREE}")
        self.register_buffer("active_degree", torch.tensor(degree))
        self.register_load_state_dict_post_hook(_refuse_other_degrees)

    def new_columns(self, points: PointCloud) -> dict[str, Tensor]:
        """The points' own colours, the same from every side."""
        rest = torch.zeros(len(points.colors), REST_COUNT, 3)
        return {"sh_dc": sh_from_rgb(points.colors), "sh_rest": rest}

    def channels(self, gaussians: Gaussians, camera: Camera) -> Channels:
        dc, rest = gaussians.appearance["sh_dc"], gaussians.appearance["sh_rest"]
        if _runs_native(gaussians.means, dc, rest):
            return {"rgb": _NativeColors.apply(gaussians.means, dc, rest, camera.native, int(self.active_degree))}
        colors = sh_colors_reference
        if runs_triton(gaussians.means, dc, rest):
            from ringlight.color.harmonics_triton import sh_colors_by_triton

            colors = sh_colors_by_triton
        return {"rgb": colors(gaussians.means, dc, rest, camera.position, int(self.active_degree))}

    def layers(self, gaussians: Gaussians, camera: Camera) -> Channels:
        """The colour without a view, and what the view adds (signed)."""
        base = rgb_from_sh(gaussians.appearance["sh_dc"])
        return {"base": base.clamp_min(0), "residual": self.channels(gaussians, camera)["rgb"] - base}

    def wanted(self, gaussians: Gaussians) -> Bool[Tensor, "N"]:
        """Every row is shown."""
        return torch.ones(len(gaussians), dtype=torch.bool, device=gaussians.means.device)

    def direct(self) -> "DirectHarmonics | None":
        """The same without autograd, by the kernels; None where these are missing."""
        return None if _kernels is None else DirectHarmonics(self.active_degree)


def _refuse_other_degrees(harmonics: nn.Module, _: object) -> None:
    """Files hold the degree as a number: ValueError for one that no harmonics have."""
    degree = int(harmonics.get_buffer("active_degree"))
    if not 0 <= degree <= MAX_DEGREE:
        raise ValueError(f"active_degree is {degree}, not 0 to {MAX_DEGREE}")


def sh_colors_reference(
    means: Float[Tensor, "N 3"],
    dc: Float[Tensor, "N 3"],
    rest: Float[Tensor, "N 15 3"],
    position: Float[Tensor, "3"],
    degree: int,
) -> Float[Tensor, "N 3"]:
    """Slow twin of the native kernel: colour towards a camera at ``position``, clamped at black, any float dtype."""
    basis = sh_basis(view_directions(means, position.to(means)), degree)[:, 1:]
    seen = torch.einsum("nk,nkc->nc", basis, rest[:, : basis.shape[1]])
    return (GREY + C0 * dc + seen).clamp_min(0)


def _runs_native(*tensors: Tensor) -> bool:
    usable = (tensor.dtype == torch.float32 and tensor.is_cpu and tensor.is_contiguous() for tensor in tensors)
    return _kernels is not None and all(usable)


class _NativeColors(torch.autograd.Function):
    """Colours and their gradients to means, dc and rest in one pass over the table each."""

    @staticmethod
    def forward(ctx: Any, means: Tensor, dc: Tensor, rest: Tensor, camera: "_kernels.Camera", degree: int) -> Tensor:
        colors, slopes = torch.empty_like(means), means.new_empty(_kernels.sh_slopes(len(means)))
        _kernels.sh_colors(means, dc, rest, camera, degree, colors, slopes)
        ctx.save_for_backward(means, rest, colors, slopes)
        ctx.camera, ctx.degree = camera, degree
        return colors

    @staticmethod
    @once_differentiable
    def backward(ctx: Any, upstream: Tensor) -> tuple[Tensor, Tensor, Tensor, None, None]:
        means, rest, colors, slopes = ctx.saved_tensors
        by_means, by_dc, by_rest = torch.empty_like(means), torch.empty_like(means), torch.empty_like(rest)
        _kernels.sh_gradient(upstream.contiguous(), colors, slopes, by_means, by_dc, False)
        _kernels.sh_rest_gradient(means, ctx.camera, ctx.degree, by_dc, by_rest)
        return by_means, by_dc, by_rest, None, None


@dataclass(frozen=True)
class RestGradient:
    """dL/d(sh_rest) as it comes: the harmonics' values, made anew from means and camera, times dL/d(sh_dc)."""

    means: Float[Tensor, "N 3"]
    camera: "_kernels.Camera"
    degree: int
    by_dc: Float[Tensor, "N 3"]

    def dense(self) -> Float[Tensor, "N 15 3"]:
        """Written down; zero above the degree."""
        by_rest = self.means.new_empty(len(self.means), REST_COUNT, 3)
        _kernels.sh_rest_gradient(self.means, self.camera, self.degree, self.by_dc, by_rest)
        return by_rest

    def adam_(self, value: Tensor, mean: Tensor, square: Tensor, step: AdamStep) -> int:
        """One update with :meth:`dense`, which is never written. Harmonics that were never in use are left alone."""
        return _kernels.sh_rest_adam(self.means, self.camera, self.degree, self.by_dc, value, mean, square, step)


class DirectHarmonics:
    """One view at a time: :meth:`draw`, then :meth:`differentiate`. Arrays are used again by the next view."""

    widths: Mapping[str, int] = {"rgb": 3}
    opacity_factor: Float[Tensor, "N"] | None = None
    late: "_kernels.LazyColors | None" = None

    def __init__(self, active_degree: Tensor):
        self._active_degree = active_degree
        self._colors = self._by_dc = self._slopes = torch.empty(0, 3, dtype=torch.float32, device="cpu")

    def draw(self, gaussians: Gaussians, camera: Camera, may_be_late: bool = False) -> Float[Tensor, "N 3"]:
        """What :meth:`SphericalHarmonics.channels` calls "rgb"."""
        means, dc, rest = gaussians.means, gaussians.appearance["sh_dc"], gaussians.appearance["sh_rest"]
        self._seen = means, camera.native, int(self._active_degree)
        if self._colors.shape != means.shape:
            self._colors, self._by_dc = torch.empty_like(means), torch.empty_like(means)
            self._slopes = means.new_empty(_kernels.sh_slopes(len(means)))
        _kernels.sh_colors(means, dc, rest, *self._seen[1:], self._colors, self._slopes)
        return self._colors

    def differentiate(self, by_channels: Float[Tensor, "N 3"], by_geometry: dict[str, Tensor]) -> dict[str, Gradient]:
        """See :class:`ringlight.color.contract.DirectColor`."""
        _kernels.sh_gradient(by_channels, self._colors, self._slopes, by_geometry["means"], self._by_dc, True)
        return {"sh_dc": self._by_dc, "sh_rest": RestGradient(*self._seen, self._by_dc)}
