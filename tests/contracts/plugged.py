"""Everything that is plugged in, by socket: the product's tables and the five plugs of tests/plugs. A plug is a line.

Small sizes: contracts are about what must hold, not about how well it looks.
"""

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import torch
from torch import nn

from plugs.directional_opacity import DirectionalOpacity
from plugs.environment import Environment, HarmonicsWithNormals
from ringlight.color.basis_opacities import BasisOpacities
from ringlight.color.glossy_harmonics import GlossyHarmonics
from ringlight.color.harmonics import SphericalHarmonics
from ringlight.color.illuminated import Illuminated
from ringlight.color.illumination_settings import IlluminationSettings
from ringlight.color.light_fields import FIELDS
from ringlight.color.mirror import Mirror
from ringlight.color.reflective_harmonics import ReflectiveHarmonics
from ringlight.color.ringlight import RingLight
from ringlight.color.ringlight_settings import RingLightSettings
from ringlight.color.shaded_gaussians import ShadedGaussians
from ringlight.color.shared_basis import SharedBasis
from ringlight.color.split_sum import SplitSumLight
from ringlight.color.varying_mirror import VaryingMirror
from ringlight.fields.ring_settings import KnotSettings, PerceptronSettings, RingSettings, VectorMatrixSettings
from ringlight.fit.regularizers.appearance_variation import AppearanceVariation
from ringlight.fit.regularizers.by_torch import TorchRegularizer
from ringlight.fit.regularizers.contract import Regularizer
from ringlight.fit.regularizers.depth_normals import DepthNormals
from ringlight.fit.regularizers.factor_size import FactorSize
from ringlight.fit.regularizers.factor_variation import FactorVariation
from ringlight.fit.regularizers.mean_mask import MeanMask
from ringlight.fit.regularizers.mean_opacity import MeanOpacity
from ringlight.fit.regularizers.mean_scale import MeanScale
from ringlight.fit.regularizers.small_columns import SmallColumn
from ringlight.fit.regularizers.zero_one import ZeroOne
from ringlight.shade.environment import EnvironmentShader
from ringlight.shade.passthrough import PassThrough
from ringlight.shade.reflection import ReflectionShader
from ringlight.shade.reflection_settings import ReflectionSettings

SCALES = "columns.log_scales"

BOX = torch.tensor([[-1.0, -1.2, -0.9], [1.1, 1.0, 1.3]])

RING = RingSettings(
    rank=3, features=5, head_hidden=8, bands=2, view_bands=2, position_nodes=9, view_nodes=5, core_scale=0.5
)
LIGHT = RingLightSettings(
    RING,
    render_hidden=8,
    modulation_hidden=6,
    latents=2,
    mask=True,
    knots=KnotSettings(axis=7, view=5),
    vm=VectorMatrixSettings(side=6, components=2, view=5),
    mlp=PerceptronSettings(hidden=8, layers=2),
)
"""All of its gradients are computed: a share of them is right in expectation only."""

ILLUMINATION = IlluminationSettings(side=6, components=3, features=5, hidden=8)


def shaded_gaussians(**settings: Any) -> ShadedGaussians:
    """Under an environment of two mips, of any light."""
    light = SplitSumLight(8, coarsest=4)
    with torch.no_grad():
        light.texels.copy_(torch.randn(light.texels.shape, generator=torch.Generator().manual_seed(1)))
    return ShadedGaussians(light, **settings)


COLOR_MODELS: dict[str, Callable[[], nn.Module]] = {
    "harmonics": SphericalHarmonics,
    "harmonics of degree 1": lambda: SphericalHarmonics(1),
    **{f"light: {name}": lambda name=name: RingLight(replace(LIGHT, field=name), BOX, 1) for name in FIELDS},
    "light, exact heads": lambda: RingLight(replace(LIGHT, evaluation="exact"), BOX, 1),
    "light, bare": lambda: RingLight(replace(LIGHT, mask=False, latents=0, light_modulation=False), BOX, 1),
    "light, no base colour": lambda: RingLight(replace(LIGHT, base_color=False), BOX, 1),
    "illuminated": lambda: Illuminated(ILLUMINATION, BOX, 1),
    "mirror": lambda: Mirror(latents=3, seed=1),
    "mirror, many latents": lambda: Mirror(latents=12, seed=1),
    "mirror, varying": lambda: VaryingMirror(latents=3, basis_size=2, seed=1),
    "mirror, varying opacities": lambda: VaryingMirror(latents=3, basis_size=2, seed=1, opacities=True),
    "reflective harmonics": ReflectiveHarmonics,
    "reflective harmonics of degree 1": lambda: ReflectiveHarmonics(1),
    "shared basis": lambda: SharedBasis(3, seed=1),
    "shared basis, varying opacities": lambda: BasisOpacities(3, seed=1),
    "glossy harmonics": GlossyHarmonics,
    "glossy harmonics, opacities of degree 1": lambda: GlossyHarmonics(2, 1),
    "shaded": lambda: shaded_gaussians(),
    "shaded, ambient": lambda: shaded_gaussians(degree=1, ambient=True),
    "plug: directional opacity": DirectionalOpacity,
    "plug: harmonics with normals": HarmonicsWithNormals,
}

FIELD_NAMES = tuple(FIELDS)

REFLECTION = ReflectionSettings(hidden=8, levels=(4, 7), features=4, latents=3, axis_nodes=4)

SHADERS: dict[str, Callable[[], nn.Module]] = {
    "pass-through": PassThrough,
    "reflection": lambda: ReflectionShader(REFLECTION, BOX, 1),
    "reflection, depth": lambda: ReflectionShader(replace(REFLECTION, depth_gradient=True), BOX, 1),
    "reflection, directions alone": lambda: ReflectionShader(replace(REFLECTION, parallax=False, axis_nodes=0), BOX, 1),
    "reflection, ring": lambda: ReflectionShader(replace(REFLECTION, ring="full", near_field=RING), BOX, 1),
    "environment": lambda: EnvironmentShader(5, seed=1),
    "plug: environment": lambda: Environment(5, seed=1),
}

CONSTANT: dict[str, tuple[str, ...]] = {"reflection": ("depth",), "reflection, ring": ("depth",)}
"""Channels that a shader reads and takes for constant by its settings: they get no gradient, nor does alpha through
them. A shader that is not named here has the gradient of all that it reads."""

REGULARIZERS: dict[str, Callable[[], Regularizer]] = {
    "appearance variation": lambda: AppearanceVariation(0.5, 3),
    "mean mask": lambda: MeanMask(0.2),
    "mean opacity": lambda: MeanOpacity(0.3),
    "mean scale": lambda: MeanScale(0.7),
    "factor size": lambda: FactorSize(lambda: (SCALES,), first=0.2, rest=0.1, until=5),
    "factor variation": lambda: FactorVariation((SCALES,), weight=15.0, steps=10, end=0.1),
    "depth normals": lambda: DepthNormals(0.2),
    "depth normals, every other pixel": lambda: DepthNormals(0.2, 2),
    "depth normals, of one surface": lambda: DepthNormals(0.2, least_cosine=0.3),
    "depth normals, every third step": lambda: DepthNormals(0.2, steps=range(0, 999, 3)),
    "zero-one": lambda: ZeroOne(0.4),
    "small column": lambda: SmallColumn(SCALES, 0.5),
    "by torch, of a column": lambda: TorchRegularizer(lambda of: of[SCALES].exp().mean(), (SCALES,)),
    "by torch, of a buffer": lambda: TorchRegularizer(lambda of: of["alpha"].sin().mean(), buffers=("alpha",)),
    "by torch, of both": lambda: TorchRegularizer(
        lambda of: of["depth"].square().mean() * of["alpha"].mean() + of[SCALES].square().mean(),
        (SCALES,),
        ("depth", "alpha"),
    ),
}
"""Of a model with visibility masks, but that of appearance of a volume."""
