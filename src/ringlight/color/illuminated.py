"""The colour model of 3iGS (Tang and Cham 2024): base colours, and what each Gaussian makes of a field of light."""

from collections.abc import Mapping, Sequence
from dataclasses import replace

import torch
from jaxtyping import Bool, Float, Int
from torch import Tensor, nn

from ringlight.color.by_torch import emitted_by_torch
from ringlight.color.drawable import drawable_rows
from ringlight.color.harmonics import runs_native
from ringlight.color.illuminated_kernel import (
    FEATURES,
    ROUGHNESS,
    ROUGHNESS_SHIFT,
    LitView,
    illuminated_gradients,
    illuminated_specular,
    lit_view,
)
from ringlight.color.illumination_settings import IlluminationSettings
from ringlight.core.camera import Camera
from ringlight.core.directions import view_directions
from ringlight.core.gaussians import Gaussians
from ringlight.core.gradients import COLOR, COLUMNS, Gradients
from ringlight.core.importance_sampling import importance_sampled
from ringlight.core.light_features import LightFeatures, evenly, flat_tanh
from ringlight.core.randomness import generator
from ringlight.core.rendering import Channels, Emission
from ringlight.core.scene import DARKEST, PointCloud
from ringlight.core.sh_basis import sh_from_rgb
from ringlight.core.want import Want
from ringlight.fields.directional_encoding import CODE_WIDTH, directional_encoding
from ringlight.fields.illumination import Illumination
from ringlight.fields.networks import PerceptronStack

BASE = "base"


class Illuminated(nn.Module):
    """c(v) = clamp(c_b + tanh(MLP(tanh f, tanh L(p), v, IDE(v, roughness))), 0, 1), with L the illumination field.

    Columns: ``base`` [N 3], the base colour's logit; ``roughness`` [N], of which :data:`ROUGHNESS_SHIFT` tells the
    stored form; ``features`` [N F], what the network is told of a Gaussian. Buffers: ``box`` [low, high], what the
    field's [-1, 1]^3 covers, world units; ``lit``, False during the warm-up, when base colours alone are shown.
    Positions and directions get no gradient from the light, as in 3iGS.
    """

    box: Tensor
    lit: Tensor
    emits: Mapping[str, int] = {"rgb": 3}
    training_columns: tuple[str, ...] = ()
    opacity_columns: tuple[str, ...] = ()
    axes_are_normals: bool = False

    def __init__(
        self, settings: IlluminationSettings, box: Float[Tensor, "2 3"], seed: int = 0, gradient_share: float = 1.0
    ):
        super().__init__()
        drawn = generator(seed, 0, "networks")
        self.settings, self._seed, self._share = settings, seed, gradient_share
        self.field = Illumination(settings.side, settings.components, settings.features, drawn)
        width = 2 * settings.features + 3 + CODE_WIDTH
        self.network = PerceptronStack(1, (width, settings.hidden, settings.hidden, 3), drawn)
        self.register_buffer("box", box.clone().float())
        self.register_buffer("lit", torch.tensor(True))

    def new_columns(self, points: PointCloud) -> dict[str, Tensor]:
        """Base colours equal to the points'; roughness drawn from [0, 1) and features that begin with the colour, as in
        3iGS. The draw is the same at every call."""
        count, colors = len(points.colors), points.colors
        features = colors.new_zeros(count, self.settings.features)
        features[:, :3] = sh_from_rgb(colors)
        roughness = torch.rand(count, generator=generator(self._seed, 0, ROUGHNESS)).to(colors)
        return {BASE: colors.clamp(DARKEST, 1 - DARKEST).logit(), ROUGHNESS: roughness, FEATURES: features}

    def emit(self, gaussians: Gaussians, camera: Camera, names: Sequence[str], want: Want) -> Emission:
        """ "rgb" [N 3], in [0, 1]. Rows that the camera cannot see get their base colour."""
        parameters = [parameter for _, parameter in self.named_parameters()]
        if runs_native(gaussians.means, *gaussians.appearance.values(), *parameters):
            return self._native_emission(gaussians, camera, want)

        def channels(columns: dict[str, Tensor]) -> Channels:
            base = columns[BASE].sigmoid()
            if not self.lit:
                return {"rgb": base}
            rows = drawable_rows(gaussians, camera).long()
            specular = self.specular_reference(replace(gaussians, appearance=columns), camera, rows)
            lit = (base[rows] + importance_sampled(specular, self._share)).clamp(0, 1)
            return {"rgb": base.index_put((rows,), lit)}

        named = {COLOR + name: parameter for name, parameter in self.named_parameters()}
        return emitted_by_torch(channels, dict(gaussians.appearance), named if self.lit else {}, want)

    @torch.no_grad()
    def _native_emission(self, gaussians: Gaussians, camera: Camera, want: Want) -> Emission:
        base = gaussians.appearance[BASE].sigmoid()
        light = self._lit(gaussians, camera) if self.lit else None
        if light is None:
            return Emission(self.emits, base, backward=lambda grad, _, into: _add_base(grad, base, into))
        specular = illuminated_specular(light)
        whole = base[light.rows] + specular
        colors = base.index_copy(0, light.rows, whole.clamp(0, 1))
        if want is not Want.GRADIENTS:
            return Emission(self.emits, colors)
        passing = (whole >= 0) & (whole <= 1)

        @torch.no_grad()
        def backward(grad_channels: Tensor, _: Tensor | None, into: Gradients) -> None:
            upstream = grad_channels[light.rows] * passing
            _add_base(grad_channels.index_copy(0, light.rows, upstream), base, into)
            of_columns, of_color = illuminated_gradients(light, upstream, self._share)
            into.add_all({COLUMNS + name: gradient for name, gradient in of_columns.items()})
            into.add_all({COLOR + name: gradient for name, gradient in of_color.items()})

        return Emission(self.emits, colors, backward=backward)

    def _lit(self, gaussians: Gaussians, camera: Camera) -> LitView | None:
        """The rows that the camera may see; None if there are none."""
        rows = drawable_rows(gaussians, camera)
        if not len(rows):
            return None
        return lit_view(self.field, self.network, gaussians, rows, camera, self.box)

    def specular_reference(self, gaussians: Gaussians, camera: Camera, rows: Int[Tensor, "V"]) -> Float[Tensor, "V 3"]:
        """What the kernels add to base colours, in torch and in any precision: slow, and their judge."""
        result: Tensor = self.network(self._inputs(gaussians, camera, rows)[None])[0].tanh()
        return result

    def _inputs(self, gaussians: Gaussians, camera: Camera, rows: Int[Tensor, "V"]) -> Float[Tensor, "V W"]:
        """What the network is given of these rows."""
        means, appearance = gaussians.means.detach()[rows], gaussians.appearance
        directions = view_directions(means, camera.position.to(means))
        light = self.field(self.unit_points(means))
        code = directional_encoding(directions, roughness_of(appearance[ROUGHNESS][rows]))
        return torch.cat([appearance[FEATURES][rows].tanh(), light.tanh(), directions, code], -1)

    @torch.no_grad()
    def layers(self, gaussians: Gaussians, camera: Camera) -> Channels:
        """ "base" [N 3], and "residual" [N 3], signed: what the light adds; zero where the camera cannot see and during
        the warm-up."""
        base = gaussians.appearance[BASE].sigmoid()
        residual = torch.zeros_like(base)
        if self.lit:
            rows = drawable_rows(gaussians, camera).long()
            residual[rows] = self.specular_reference(gaussians, camera, rows)
        return {"base": base, "residual": residual}

    @torch.no_grad()
    def features(self, gaussians: Gaussians, camera: Camera) -> LightFeatures | None:
        """The field's, behind their tanh, at Gaussians in the picture; None during the warm-up."""
        if not self.lit:
            return None
        rows, count = drawable_rows(gaussians, camera).long(), self.settings.features
        inputs = self._inputs(gaussians, camera, rows[evenly(len(rows)).to(rows.device)])
        hidden, units = inputs, []
        for weights, biases in list(zip(self.network.weights, self.network.biases, strict=True))[:-1]:
            hidden = torch.relu(hidden @ weights[0] + biases[0])
            units.append(hidden)
        values = inputs[:, count : 2 * count]
        return LightFeatures(values, flat_tanh(values), torch.cat(units, -1))

    def wanted(self, gaussians: Gaussians) -> Bool[Tensor, "N"]:
        """Every row is shown."""
        return torch.ones(len(gaussians), dtype=torch.bool, device=gaussians.means.device)

    def harmonics(self, gaussians: Gaussians) -> None:
        """None: the colour is a network's."""

    def unit_points(self, means: Float[Tensor, "N 3"]) -> Float[Tensor, "N 3"]:
        """World positions in the field's coordinates: the box to [-1, 1]^3, clamped."""
        low, high = self.box.to(means)
        return ((means - low) * (2 / (high - low)) - 1).clamp(-1, 1)


def roughness_of(stored: Float[Tensor, "V"]) -> Float[Tensor, "V"]:
    """The inverse concentration, 0 or more, of stored numbers."""
    return nn.functional.softplus(stored - ROUGHNESS_SHIFT)


def _add_base(grad_colors: Float[Tensor, "N 3"], base: Float[Tensor, "N 3"], into: Gradients) -> None:
    into.add(COLUMNS + BASE, grad_colors * base * (1 - base))
