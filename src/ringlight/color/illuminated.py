"""The colour model of 3iGS (Tang and Cham 2024): base colours, and what each Gaussian makes of a field of light."""

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import NamedTuple

import torch
from jaxtyping import Bool, Float, Int
from torch import Tensor, nn

from ringlight import _kernels
from ringlight.color.by_torch import emitted_by_torch
from ringlight.color.drawable import drawable_rows
from ringlight.color.harmonics import runs_native
from ringlight.color.illumination_settings import IlluminationSettings
from ringlight.core.camera import Camera
from ringlight.core.directions import view_directions
from ringlight.core.gaussians import Gaussians
from ringlight.core.gradients import COLOR, COLUMNS, Gradients
from ringlight.core.importance_sampling import importance_sampled, importance_weights
from ringlight.core.light_features import LightFeatures, evenly, flat_tanh
from ringlight.core.randomness import generator
from ringlight.core.rendering import Channels, Emission
from ringlight.core.scene import PointCloud
from ringlight.core.sh_basis import sh_from_rgb
from ringlight.core.want import Want
from ringlight.fields.directional_encoding import (
    CODE_WIDTH,
    directional_encoding_reference,
    fading,
    write_directional_encoding,
)
from ringlight.fields.illumination import Illumination
from ringlight.fields.networks import PerceptronStack
from ringlight.fields.perceptron_kernel import stack_at, stack_gradients

BASE, ROUGHNESS, FEATURES = "base", "roughness", "features"

ROUGHNESS_SHIFT = 1.0
"""Roughness is softplus(stored - 1), as in Ref-NeRF and 3iGS."""

DARKEST = 0.25 / 255
"""The logit of pure black or white would be infinite; a quarter of an 8-bit step away still rounds to either."""


class LitRows(NamedTuple):
    """What the network is given of the Gaussians that a camera may see, and what that was made of."""

    rows: Int[Tensor, "V"]
    points: Float[Tensor, "V 3"]
    products: Float[Tensor, "V J"]
    inputs: Float[Tensor, "V W"]


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
        seen = self._lit_rows(gaussians, camera) if self.lit else None
        if seen is None or not len(seen.rows):
            return Emission(self.emits, base, backward=lambda grad, _, into: _add_base(grad, base, into))
        specular = stack_at(self.network, seen.inputs[None])[0].tanh_()
        whole = base[seen.rows] + specular
        colors = base.index_copy(0, seen.rows, whole.clamp(0, 1))
        if want is not Want.GRADIENTS:
            return Emission(self.emits, colors)
        passing = (whole >= 0) & (whole <= 1)

        @torch.no_grad()
        def backward(grad_channels: Tensor, _: Tensor | None, into: Gradients) -> None:
            upstream = grad_channels[seen.rows] * passing
            _add_base(grad_channels.index_copy(0, seen.rows, upstream), base, into)
            self._add_light(gaussians, seen, upstream, specular, into)

        return Emission(self.emits, colors, backward=backward)

    def _add_light(
        self,
        gaussians: Gaussians,
        seen: LitRows,
        upstream: Float[Tensor, "V 3"],
        specular: Float[Tensor, "V 3"],
        into: Gradients,
    ) -> None:
        """Of all that the light is made of, by dL/d(specular); rows without a gradient cost nothing."""
        if self._share < 1:
            upstream = upstream * importance_weights(upstream, self._share)[:, None]
        taken = upstream.ne(0).any(-1).nonzero()[:, 0]
        if not len(taken):
            return
        count, inputs, products = self.settings.features, seen.inputs[taken], seen.products[taken]
        of_results, of_inputs = upstream[taken] * (1 - specular[taken] ** 2), torch.empty_like(inputs)
        of_network = stack_gradients(self.network, inputs[None], of_results[None], of_inputs[None])
        # What the network was given behind a tanh: features of Gaussians, then of the field.
        of_both = of_inputs[:, : 2 * count] * (1 - inputs[:, : 2 * count] ** 2)
        of_field = self.field.gradients(seen.points[taken], products, of_both[:, count:])
        faded = (of_inputs[:, -CODE_WIDTH:] * inputs[:, -CODE_WIDTH:]) @ -fading()
        rows, stored = seen.rows[taken], gaussians.appearance[ROUGHNESS]
        of_roughness = faded * (stored[rows] - ROUGHNESS_SHIFT).sigmoid()
        of_features = torch.zeros_like(gaussians.appearance[FEATURES]).index_copy_(0, rows, of_both[:, :count])
        into.add(COLUMNS + ROUGHNESS, torch.zeros_like(stored).index_copy_(0, rows, of_roughness))
        into.add(COLUMNS + FEATURES, of_features)
        into.add_all({f"{COLOR}network.{name}": gradient for name, gradient in of_network.items()})
        into.add_all({f"{COLOR}field.{name}": gradient for name, gradient in of_field.items()})

    def _lit_rows(self, gaussians: Gaussians, camera: Camera) -> LitRows:
        numbers, count = drawable_rows(gaussians, camera), self.settings.features
        rows = numbers.long()
        means, appearance = gaussians.means.detach()[rows], gaussians.appearance
        points, directions = self.unit_points(means), view_directions(means, camera.position.to(means))
        products = self.field.products(points)
        inputs = means.new_empty(len(rows), 2 * count + 3 + CODE_WIDTH)
        if runs_native(means, appearance[FEATURES], products):
            _kernels.tanh_rows(appearance[FEATURES], numbers, inputs, 0)
            _kernels.tanh_rows(self.field.mixed(products), None, inputs, count)
        else:
            inputs[:, : 2 * count] = torch.cat([appearance[FEATURES][rows], self.field.mixed(products)], -1).tanh()
        inputs[:, 2 * count : 2 * count + 3] = directions
        write_directional_encoding(directions, roughness_of(appearance[ROUGHNESS][rows]), inputs, 2 * count + 3)
        return LitRows(rows, points, products, inputs)

    def specular_reference(self, gaussians: Gaussians, camera: Camera, rows: Int[Tensor, "V"]) -> Float[Tensor, "V 3"]:
        """What the kernels add to base colours, in torch and in any precision: slow, and their judge."""
        means, appearance = gaussians.means.detach()[rows], gaussians.appearance
        directions = view_directions(means, camera.position.to(means))
        light = self.field.reference(self.unit_points(means))
        code = directional_encoding_reference(directions, roughness_of(appearance[ROUGHNESS][rows]))
        inputs = torch.cat([appearance[FEATURES][rows].tanh(), light.tanh(), directions, code], -1)
        result: Tensor = self.network(inputs[None])[0].tanh()
        return result

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
        seen, count = self._lit_rows(gaussians, camera), self.settings.features
        inputs = seen.inputs[evenly(len(seen.rows)).to(seen.rows.device)]
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
