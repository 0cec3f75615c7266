"""Gaussians that are shaded one by one under a learned environment: what those of GaussianShader emit.

Jiang et al. 2024, section 3: a Gaussian with normal n, tint s and roughness r, looked at along v, has the colour

    c(v) = c_d + s L(reflect(v, n), r) + c_r(v),    s L being the split sum  L_r(reflect(v, n)) (s F0 + F1)

where c_d + c_r are harmonics, the constant one and the others, L_r is the environment blurred by the lobe of roughness
r, and F0 and F1 depend on n.v and r. With ``ambient`` (1 - s) E(n) is added, E being the environment blurred by the
cosine. The normal is the shortest axis turned towards the camera plus a residual, one for each side of the Gaussian.
"""

from collections.abc import Mapping, Sequence

import torch
from jaxtyping import Bool, Float
from torch import Tensor, nn

from ringlight.color import specular_table
from ringlight.color.by_torch import emitted_by_torch
from ringlight.color.harmonics import SH_COLUMNS, SphericalHarmonics, runs_native
from ringlight.color.shaded_kernel import ShadedJob, kernel_takes
from ringlight.color.split_sum import FIRST_LIGHT, SMOOTHEST, SplitSumLight
from ringlight.core.camera import Camera
from ringlight.core.directions import normalize, reflect, view_directions
from ringlight.core.gaussians import Gaussians
from ringlight.core.gradients import COLOR, COLUMNS, Gradients
from ringlight.core.rendering import Channels, Emission
from ringlight.core.scene import PointCloud
from ringlight.core.sh_basis import MAX_DEGREE
from ringlight.core.want import Want

TINTS, ROUGHNESS, RESIDUALS = "tint_logits", "roughness_logits", "normal_residuals"

TEXELS = f"{COLOR}light.texels"
"""The environment's full name."""

COLUMN_OF = {
    "means": "means",
    "log_scales": "log_scales",
    "quats": "quats",
    "tints": TINTS,
    "roughness": ROUGHNESS,
    "residuals": RESIDUALS,
}
"""The table's columns by the names of the kernels' arguments."""

FIRST_ROUGHNESS_LOGIT = 0.6
"""As in GaussianShader: rough, so that every texel of the environment is seen from the first step on."""


class ShadedGaussians(nn.Module):
    """Columns: those of :class:`SphericalHarmonics`; "tint_logits" [N 3], of the reflectance in (0, 1);
    "roughness_logits" [N], of the roughness in (0.08, 1); "normal_residuals" [N 6], world, added to the shortest axis
    where that looks towards the camera as it is stored, the first three, or turned round, the others.

    Emits "rgb", "normal", unit, world, towards the camera, and "depth", the camera's z in world units.
    """

    emits: Mapping[str, int] = {"rgb": 3, "normal": 3, "depth": 1}
    training_columns: tuple[str, ...] = ()
    opacity_columns: tuple[str, ...] = ()
    axes_are_normals: bool = True

    def __init__(self, light: SplitSumLight, degree: int = MAX_DEGREE, ambient: bool = False, tint: float = 0.5):
        super().__init__()
        self.light, self.ambient, self.tint = light, ambient, tint
        self.harmonic = SphericalHarmonics(degree)

    def new_columns(self, points: PointCloud) -> dict[str, Tensor]:
        """Rough surfaces that have the points' colours under the first environment, as far as that is not too bright
        for them."""
        count, tints = len(points.colors), torch.full_like(points.colors, self.tint)
        f0, f1 = self._first_shares()
        reflected = FIRST_LIGHT * (self.tint * f0 + f1 + self.ambient * (1 - self.tint))
        diffuse = PointCloud(points.positions, (points.colors - reflected).clamp_min(0), points.normals)
        return self.harmonic.new_columns(diffuse) | {
            TINTS: tints.logit(),
            ROUGHNESS: torch.full((count,), FIRST_ROUGHNESS_LOGIT).to(points.colors),
            RESIDUALS: points.colors.new_zeros(count, 6),
        }

    @staticmethod
    def _first_shares() -> tuple[float, float]:
        """F0 and F1 of the first surfaces, seen from straight above."""
        roughness = SMOOTHEST + (1 - SMOOTHEST) * torch.tensor([FIRST_ROUGHNESS_LOGIT]).sigmoid()
        f0, f1 = specular_table.reflected_shares(torch.ones(1), roughness)[:, 0].tolist()
        return f0, f1

    def emit(self, gaussians: Gaussians, camera: Camera, names: Sequence[str], want: Want) -> Emission:
        """The channels ``names`` in the order of ``emits``, with what else the kernels make beside a normal; by the
        kernels for float32 on the CPU."""
        base = self.harmonic.emit(gaussians, camera, ("rgb",), want)
        if runs_native(self.light.texels, *gaussians.columns().values()) and kernel_takes(self.light):
            return self._native_emission(base, gaussians, camera, names, want)
        return self.emission_by_torch(base, gaussians, camera, names, want)

    def emission_by_torch(
        self, base: Emission, gaussians: Gaussians, camera: Camera, names: Sequence[str], want: Want
    ) -> Emission:
        """In any precision; ``base`` are the harmonics' colours."""
        read = {name: column for name, column in gaussians.columns().items() if name not in SH_COLUMNS}

        def channels(columns: dict[str, Tensor]) -> Channels:
            every = self.reflected(columns, camera)
            return {name: every[name] for name in self.emits if name in names or name == "rgb"}

        shaded = emitted_by_torch(channels, read, {TEXELS: self.light.texels}, want)
        shown = shaded.channels.clone()
        shown[:, :3] += base.channels
        if want is not Want.GRADIENTS:
            return Emission(shaded.widths, shown)

        def backward(grad_channels: Tensor, _: Tensor | None, into: Gradients) -> None:
            base.backward(grad_channels[:, :3].contiguous(), None, into)
            shaded.backward(grad_channels, None, into)

        return Emission(shaded.widths, shown, backward=backward)

    @torch.no_grad()
    def _native_emission(
        self, base: Emission, gaussians: Gaussians, camera: Camera, names: Sequence[str], want: Want
    ) -> Emission:
        widths = {"rgb": 3} if set(names) <= {"rgb"} else self.emits
        table = gaussians.columns()
        columns = {name: table[column] for name, column in COLUMN_OF.items()} | {"bases": base.channels}
        job = ShadedJob.of(columns, self.light, camera, self.ambient)
        channels = job.channels(sum(widths.values()))
        if want is not Want.GRADIENTS:
            return Emission(widths, channels)

        @torch.no_grad()
        def backward(grad_channels: Tensor, _: Tensor | None, into: Gradients) -> None:
            found, of_texels = job.gradients(grad_channels)
            of_bases = found.pop("bases")
            into.add_all({COLUMNS + COLUMN_OF[name]: gradient for name, gradient in found.items()})
            into.add(TEXELS, of_texels)
            base.backward(of_bases, None, into)

        return Emission(widths, channels, backward=backward)

    def reflected(self, columns: Mapping[str, Tensor], camera: Camera) -> Channels:
        """The light of the environment as "rgb", "normal" and "depth", in torch and in any precision."""
        table = Gaussians.from_columns(columns)
        position = camera.position.to(table.means)
        normals = surface_normals(table, columns[RESIDUALS], position)
        views = view_directions(table.means, position)
        cosines = -(views * normals).sum(-1)
        tints, roughness = columns[TINTS].sigmoid(), SMOOTHEST + (1 - SMOOTHEST) * columns[ROUGHNESS].sigmoid()
        f0, f1 = specular_table.looked_up(cosines.clamp(0, 1), roughness)
        maps = self.light.maps()
        light = self.light.specular(maps, reflect(views, normals), roughness) * (tints * f0 + f1)
        if self.ambient:
            light = light + (1 - tints) * self.light.diffuse(maps, normals)
        return {"rgb": light, "normal": normals, "depth": camera.depths(table.means)[:, None]}

    @torch.no_grad()
    def layers(self, gaussians: Gaussians, camera: Camera) -> Channels:
        """ "base" [N 3], the harmonics towards the camera, "residual" [N 3], what they reflect, "normal" [N 3], "tint"
        [N 3] and "roughness" [N 1]."""
        base = self.harmonic.emit(gaussians, camera, ("rgb",), Want.EXACT).channels
        reflected = self.reflected(gaussians.columns(), camera)
        return {
            "base": base,
            "residual": reflected["rgb"],
            "normal": reflected["normal"],
            "tint": gaussians.appearance[TINTS].sigmoid(),
            "roughness": SMOOTHEST + (1 - SMOOTHEST) * gaussians.appearance[ROUGHNESS].sigmoid()[:, None],
        }

    def features(self, gaussians: Gaussians, camera: Camera) -> None:
        """None: a cubemap is no network."""

    def wanted(self, gaussians: Gaussians) -> Bool[Tensor, "N"]:
        """Every row is shown."""
        return self.harmonic.wanted(gaussians)

    def harmonics(self, gaussians: Gaussians) -> None:
        """None: what is reflected is no harmonics."""


def surface_normals(
    gaussians: Gaussians, residuals: Float[Tensor, "N 6"], position: Float[Tensor, "3"]
) -> Float[Tensor, "N 3"]:
    """Unit, towards the camera at ``position`` but for their residual."""
    axes = stored_axes(gaussians)
    outward = ((position - gaussians.means).detach() * axes.detach()).sum(-1, keepdim=True) >= 0
    sides = residuals.split(3, -1)
    return normalize(torch.where(outward, axes + sides[0], sides[1] - axes))


def stored_axes(gaussians: Gaussians) -> Float[Tensor, "N 3"]:
    """The shortest axes, unit, as they are stored: one column of each rotation matrix, without the other two.

    Of a unit quaternion (w, u) it is (w^2 - u.u) e + 2 (u.e) u + 2 w u x e, e being the axis before it is turned.
    """
    quats = torch.nn.functional.normalize(gaussians.quats, dim=-1)
    w, u = quats[:, :1], quats[:, 1:]
    shortest = gaussians.log_scales.argmin(-1, keepdim=True)
    along = torch.zeros_like(u).scatter_(1, shortest, 1.0)
    turned = 2 * (u.gather(1, shortest) * u + w * torch.linalg.cross(u, along))
    return turned + (2 * w * w - 1) * along
