"""What the page is told of a model besides its numbers, for each kind of colour and shader that the page can show.

The page is a program of its own: it shows what it has a twin of, in the shapes that all our recipes make, and nothing
else. So kinds are told apart by type here, and a model of another kind or shape is refused by name.
"""

from dataclasses import asdict, dataclass, field
from typing import Any

from ringlight.color.basis_opacities import BasisOpacities
from ringlight.color.contract import ColorModel
from ringlight.color.glossy_harmonics import GlossyHarmonics
from ringlight.color.harmonics import SphericalHarmonics
from ringlight.color.illuminated import Illuminated
from ringlight.color.mirror import FLIP_BELOW, Mirror
from ringlight.color.reflective_harmonics import ReflectiveHarmonics
from ringlight.color.ringlight import RingLight
from ringlight.color.shaded_gaussians import ShadedGaussians
from ringlight.color.shared_basis import SharedBasis
from ringlight.color.specular_table import TABLE_NODES
from ringlight.color.varying_mirror import VaryingMirror
from ringlight.errors import RecipeError
from ringlight.fields.encoding import FourierCode
from ringlight.fields.heads import position_code, view_code
from ringlight.models.splats import SplatModel
from ringlight.shade.environment import EnvironmentShader
from ringlight.shade.passthrough import PassThrough
from ringlight.shade.reflection import ReflectionShader

FOUR = 4
"""Numbers in a texel, and in what a shader multiplies at once: ranks and widths of networks are multiples of it."""

LARGEST_NETWORK = 65_536
"""Bytes of a mirror's network: what nearly all browsers hand a shader in one block."""

BASES = (SharedBasis, BasisOpacities)

WIDEST_RANK, WIDEST_HIDDEN = 16, 128
"""Of a ring and its networks: a shader holds a few rows of the first and all units of the second in registers."""


@dataclass(frozen=True)
class Shown:
    """``kind`` names the page's program; ``sizes`` become its constants, ``settings`` are what else it asks for."""

    kind: str
    flip_below: float
    """Cosine between a normal and the direction to the camera below which the normal is turned round."""
    lit: bool
    """Whether the model adds light to its base colours; not before its warm-up has ended."""
    sizes: dict[str, int] = field(default_factory=dict)
    settings: dict[str, Any] = field(default_factory=dict)
    blends: bool = True
    """Whether the page can blend between lights."""


def shown_of(model: object, method: str = "a model of this kind") -> Shown:
    """How the page shows ``model``, of this ``method``. Raises RecipeError for a kind or shape of model that it cannot
    show."""
    if not isinstance(model, SplatModel):
        raise RecipeError("a page shows Gaussians, and this model is made of something else; use 'ringlight render'")
    color, shader = model.color, model.shader
    if isinstance(color, SharedBasis) and type(color) in BASES and type(shader) is PassThrough:
        return _basis(color)
    if type(color) is SphericalHarmonics and type(shader) is PassThrough:
        return _harmonics(model, color)
    if type(color) is GlossyHarmonics and type(shader) is PassThrough:
        return _harmonics(model, color.harmonic, int(color.active_opacity_degree))
    if type(color) is ReflectiveHarmonics and type(shader) is EnvironmentShader:
        sizes = {"BASIS": 0, "STORED": model.columns["sh_rest"].shape[1], "ENVIRONMENT_SIDE": shader.texels.shape[1]}
        return Shown("environment", 0.0, bool(shader.lit), sizes, {"degree": int(color.harmonic.active_degree)})
    if type(color) is ShadedGaussians and type(shader) is PassThrough:
        return _shaded(model, color)
    if type(color) is RingLight and type(shader) is PassThrough:
        return _ring(color)
    if type(color) is Illuminated and type(shader) is PassThrough:
        return _illuminated(color)
    if isinstance(shader, ReflectionShader) and type(color) in (Mirror, VaryingMirror):
        return _mirror(color, shader)
    raise _refused(method)


def _basis(color: SharedBasis) -> Shown:
    degree = int(color.active_degree)
    settings = {"degree": degree, "opacityDegree": degree if type(color) is BasisOpacities else 0}
    return Shown("basis", 0.0, True, {"BASIS": len(color.basis)}, settings)


def _harmonics(model: SplatModel, color: SphericalHarmonics, opacity_degree: int = 0) -> Shown:
    stored = model.columns["sh_rest"].shape[1]
    settings = {"degree": int(color.active_degree), "opacityDegree": opacity_degree}
    return Shown("harmonics", 0.0, stored > 0, {"BASIS": 0, "STORED": stored}, settings)


def _shaded(model: SplatModel, color: ShadedGaussians) -> Shown:
    levels = [[level.side, level.roughness or 0.0] for level in color.light.levels]
    sizes = {
        "BASIS": 0,
        "STORED": model.columns["sh_rest"].shape[1],
        "LEVELS": len(levels),
        "TABLE_NODES": TABLE_NODES,
        "AMBIENT": int(color.ambient),
    }
    return Shown("shaded", 0.0, True, sizes, {"degree": int(color.harmonic.active_degree), "levels": levels})


def _ring(color: RingLight) -> Shown:
    light, ring = color.settings, color.settings.ring
    for wrong, what in (
        (light.field != "ring", f"light.field {light.field}"),
        (light.evaluation != "tabulated", "exact heads"),
        (not light.base_color, "a light without base colours"),
        (ring.rank % FOUR or ring.rank > WIDEST_RANK, f"light.ring.rank {ring.rank}"),
        (_unfit(light.render_hidden), f"light.render_hidden {light.render_hidden}"),
        (_unfit(light.modulation_hidden), f"light.modulation_hidden {light.modulation_hidden}"),
    ):
        if wrong:
            raise _refused(what)
    sizes = {
        "RANK": ring.rank,
        "FEATURES": ring.features,
        "NODES": ring.position_nodes,
        "VIEW_SIDE": ring.view_nodes,
        "LATENTS": light.latents,
        "HIDDEN": light.render_hidden,
        "MODULATION": int(light.light_modulation),
        "MODULATION_HIDDEN": light.modulation_hidden,
        "FACTOR": int(light.light_modulation and light.modulation_as == "factor"),
        "CLAMPED": int(light.clamp_colors),
    }
    codes = {"code": _code(position_code(ring)), "viewCode": _code(view_code(ring))}
    told = codes | {"gain": list(light.residual_gain)}
    return Shown("ring", 0.0, bool(color.lit), sizes, {"ring": told, "box": color.box.tolist()})


def _illuminated(color: Illuminated) -> Shown:
    """As the page holds it, ``color/condensed_illumination.py``: how many components there are it sees itself."""
    hidden = color.settings.hidden
    if _unfit(hidden):
        raise _refused(f"light.hidden {hidden}")
    return Shown("illuminated", 0.0, bool(color.lit), {"HIDDEN": hidden}, blends=False)


def _code(code: FourierCode) -> dict[str, object]:
    return asdict(code)


def _unfit(width: int) -> bool:
    return bool(width % FOUR) or width > WIDEST_HIDDEN


def _mirror(color: ColorModel, shader: ReflectionShader) -> Shown:
    settings = shader.settings
    network = sum(parameter.numel() for parameter in shader.mlp.parameters()) * 4
    for wrong, what in (
        (settings.features != FOUR, f"shader.features {settings.features}"),
        (settings.shells != 1, f"shader.shells {settings.shells}"),
        (settings.ring != "none", f"shader.ring {settings.ring}"),
        (bool(settings.hidden % FOUR), f"shader.hidden {settings.hidden}"),
        (network > LARGEST_NETWORK, f"a network of {network:,} bytes"),
    ):
        if wrong:
            raise _refused(what)
    basis, degree, opacity_degree = 0, 0, 0
    if isinstance(color, VaryingMirror):
        basis, degree = len(color.varying.basis), int(color.varying.active_degree)
        opacity_degree = degree if isinstance(color.varying, BasisOpacities) else 0
    sizes = {
        "BASIS": basis,
        "LATENTS": settings.latents,
        "LEVELS": len(settings.sides),
        "AXIS_NODES": settings.axis_nodes,
        "HIDDEN": settings.hidden,
        "LAYERS": settings.hidden_layers,
        "PARALLAX": int(settings.parallax),
        "RAW_DIRECTION": int(settings.raw_direction),
    }
    return Shown(
        "mirror",
        FLIP_BELOW,
        bool(shader.lit) or degree > 0,
        sizes,
        {
            "mirror": {"parallax": settings.parallax, "lit": bool(shader.lit)},
            "box": shader.box.tolist(),
            "degree": degree,
            "opacityDegree": opacity_degree,
        },
    )


def _refused(what: str) -> RecipeError:
    return RecipeError(f"a page cannot show {what}; use 'ringlight render', or 'ringlight export' for other viewers")
