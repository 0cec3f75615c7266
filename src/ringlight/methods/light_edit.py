"""A model whose light is edited: its base colours tinted, what depends on the direction scaled or removed.

Stored numbers are edited wherever that is exact: the last layer of what is added is linear in harmonics, in a shared
basis and in a mirror's network. A ring's ends in a tanh, so there it is the setting ``light.residual_gain``. Networks
see base colours too: their first layer takes the tint back, so that what they add stays as it was. Kinds of models are
told apart by type here, since how each stores its light is its own.
"""

from collections.abc import Mapping
from dataclasses import dataclass

import torch
from jaxtyping import Float
from torch import Tensor

from ringlight.color.contract import ColorModel
from ringlight.color.glossy_harmonics import GlossyHarmonics
from ringlight.color.harmonics import SH_COLUMNS, SphericalHarmonics
from ringlight.color.mirror import LATENTS, Mirror
from ringlight.color.ring_emission import BASE
from ringlight.color.ringlight import RingLight
from ringlight.color.shared_basis import BASIS, DC, SharedBasis
from ringlight.color.varying_mirror import VARYING, VaryingMirror
from ringlight.core.gradients import COLOR, COLUMNS, SHADER
from ringlight.core.scene import DARKEST
from ringlight.core.sh_basis import rgb_from_sh, sh_from_rgb
from ringlight.errors import RecipeError
from ringlight.models.splats import SplatModel
from ringlight.shade.reflection import ReflectionShader

Rgb = tuple[float, float, float]

ONES: Rgb = (1.0, 1.0, 1.0)

LEAST_TINT, MOST_TINT = 0.1, 4.0
"""Of a tint's factors. Fainter base colours would be lost to the network that sees them once they are stored in eight
bits."""

MOST_RESIDUAL = 2.0
"""As the fader of a shared page has it."""

BRIGHTEST = 1 - DARKEST
"""Base colours of mirrors and rings are shares of white."""


@dataclass(frozen=True)
class LightEdit:
    """Factors of red, green and blue: of the base colours, and of what is added to them."""

    base: Rgb = ONES
    residual: Rgb = ONES


@dataclass(frozen=True)
class Edited:
    """All tensors of the model, the settings that its recipe has then, and the share of base colour values that would
    be brighter than white and are white instead."""

    tensors: dict[str, Tensor]
    settings: dict[str, object]
    clipped: float


@torch.no_grad()
def edited(model: object, settings: Mapping[str, object], edit: LightEdit) -> Edited:
    """``model`` with its light edited; ``settings`` are its recipe's, as a model file holds them.

    Raises RecipeError for a model that has nothing of what is edited, or of a kind that is not known here.
    """
    if not isinstance(model, SplatModel):
        raise RecipeError("only the light of Gaussians can be edited, and this model is made of something else")
    tensors, changed, clipped = model.rendering_tensors(), dict(settings), 0.0
    if isinstance(model.color, VaryingMirror):
        if edit.residual not in (ONES, edit.base):
            refuse_unlit(model)
        return _edited_varying(model, tensors, changed, edit)
    if edit.residual != ONES:
        if edit.residual != edit.base:  # a tint of all light finds what there is
            refuse_unlit(model)
        _scale_residual(model, tensors, changed, edit.residual)
    if edit.base != ONES:
        clipped = _tint_base(model, tensors, edit.base)
    return Edited(tensors, changed, clipped)


def refuse_unlit(model: SplatModel) -> None:
    """Raise RecipeError for a model that shows the same colours in all directions."""
    color, shader = model.color, model.shader
    harmonic = _harmonics(color)
    if harmonic is not None:
        lit = int(harmonic.active_degree) > 0 and (isinstance(color, SharedBasis) or harmonic.degree > 0)
    elif isinstance(color, RingLight):
        lit = bool(color.lit)
    else:
        lit = not isinstance(shader, ReflectionShader) or bool(shader.lit)
    if not lit:
        raise RecipeError(
            "nothing in this model depends on the direction yet, so there is no such part to edit; edit its base "
            "colours by --tint, or name a model that was trained further"
        )


def _scale_residual(model: SplatModel, tensors: dict[str, Tensor], settings: dict[str, object], factors: Rgb) -> None:
    color, shader = model.color, model.shader
    if isinstance(color, SharedBasis):
        _multiply(tensors, COLOR + BASIS, factors)
    elif _harmonics(color) is not None:
        _multiply(tensors, COLUMNS + SH_COLUMNS[1], factors)
    elif isinstance(color, RingLight):
        light = dict(_group(settings["light"]))
        before = light.get("residual_gain", ONES)
        assert isinstance(before, (list, tuple))
        light["residual_gain"] = [gain * factor for gain, factor in zip(before, factors, strict=True)]
        settings["light"] = light
    elif isinstance(color, Mirror) and isinstance(shader, ReflectionShader):
        last = f"{SHADER}mlp.{len(shader.mlp) - 1}"
        _multiply(tensors, f"{last}.weight", factors, rows=True)
        _multiply(tensors, f"{last}.bias", factors)
    else:
        raise _unknown(model)


def _tint_base(model: SplatModel, tensors: dict[str, Tensor], factors: Rgb) -> float:
    """The share of values that were clipped."""
    color, shader = model.color, model.shader
    if _harmonics(color) is not None:
        shown = rgb_from_sh(tensors[COLUMNS + DC].double())
        tensors[COLUMNS + DC] = sh_from_rgb(shown * shown.new_tensor(factors)).float()
        return 0.0
    if COLUMNS + BASE not in tensors:
        raise RecipeError("this model has no base colours to tint; tint what it adds by --tint-residual")
    if isinstance(color, RingLight):
        shading = color.shading
        seen = color.settings.ring.features + int(shading.modulation is not None and not shading.weighs)
        _take_back(tensors, f"{COLOR}shading.render.0.weight", seen, factors)
    elif isinstance(color, Mirror) and isinstance(shader, ReflectionShader):
        _take_back(tensors, f"{SHADER}mlp.0.weight", 1 + shader.settings.latents, factors)
    else:
        raise _unknown(model)
    tensors[COLUMNS + BASE], clipped = tinted_logits(tensors[COLUMNS + BASE], factors)
    return clipped


def _edited_varying(
    model: SplatModel, tensors: dict[str, Tensor], settings: dict[str, object], edit: LightEdit
) -> Edited:
    """A mirror whose base colours change with the view: its network sees them as they were.

    It saw c + r, a constant colour and what the view adds. Blended are c' and f r now, so it sees (c' + f r) / f, and
    c - c' / f as three more latents; where an earlier edit left such latents they take it in.
    """
    shader = model.shader
    assert isinstance(shader, ReflectionShader)
    before = tensors[COLUMNS + BASE].double().sigmoid()
    tensors[COLUMNS + BASE], clipped = tinted_logits(tensors[COLUMNS + BASE], edit.base)
    after = tensors[COLUMNS + BASE].double().sigmoid()
    factors = before.new_tensor(edit.residual)
    inverse = torch.where(factors > 0, 1 / factors, 0)
    _multiply(tensors, COLOR + VARYING + BASIS, edit.residual)
    last = f"{SHADER}mlp.{len(shader.mlp) - 1}"
    _multiply(tensors, f"{last}.weight", edit.residual, rows=True)
    _multiply(tensors, f"{last}.bias", edit.residual)
    lost = (before - after * inverse).float()
    first, seen = f"{SHADER}mlp.0.weight", 1 + shader.settings.latents
    weight = tensors[first]
    of_base = weight[:, seen : seen + 3]
    scaled = of_base * inverse.to(weight)
    taken = _share_taken(weight[:, seen - 3 : seen], of_base) if shader.settings.latents >= 3 else None
    if taken is not None:
        latents = tensors[COLUMNS + LATENTS].clone()
        latents[:, -3:] += taken * lost
        tensors[COLUMNS + LATENTS] = latents
        tensors[first] = torch.cat([weight[:, :seen], scaled, weight[:, seen + 3 :]], 1)
    elif any(edit.residual) and bool((lost.abs() > NOTHING).any()):
        tensors[COLUMNS + LATENTS] = torch.cat([tensors[COLUMNS + LATENTS], lost], 1)
        tensors[first] = torch.cat([weight[:, :seen], of_base, scaled, weight[:, seen + 3 :]], 1)
    else:
        tensors[first] = torch.cat([weight[:, :seen], scaled, weight[:, seen + 3 :]], 1)
    settings["shader"] = {**_group(settings["shader"]), "latents": tensors[COLUMNS + LATENTS].shape[1]}
    return Edited(tensors, settings, clipped)


NOTHING = 1e-6
"""Of a colour: rounding."""

ALIKE = 1e-5
"""Weights of latents that an edit has added are those of base colours but for a factor, up to so much of them."""


def _share_taken(of_latents: Float[Tensor, "H 3"], of_base: Float[Tensor, "H 3"]) -> Float[Tensor, "3"] | None:
    """What a base colour times this factor is to the last three latents; None where no edit has added them."""
    factors = (of_latents * of_base).sum(0) / of_latents.square().sum(0).clamp_min(SMALLEST_SQUARE)
    off = (of_base - factors * of_latents).abs().amax()
    return factors if bool(off <= ALIKE * of_base.abs().amax()) else None


SMALLEST_SQUARE = 1e-20
"""So that weights of zero are divided by something."""


def tinted_logits(logits: Float[Tensor, "N 3"], factors: Rgb) -> tuple[Float[Tensor, "N 3"], float]:
    """Logits of base colours times ``factors``, at most white, and the share of values that would be brighter."""
    shares = logits.double().sigmoid()
    wanted = shares * shares.new_tensor(factors)
    tinted = torch.where(wanted == shares, logits.double(), wanted.clamp_max(BRIGHTEST).logit())
    over = (wanted > BRIGHTEST) & (wanted > shares)
    return tinted.float(), float(over.double().mean()) if len(logits) else 0.0


def _multiply(tensors: dict[str, Tensor], name: str, factors: Rgb, rows: bool = False) -> None:
    """By colour, which is the last axis, or with ``rows`` the first."""
    values = tensors[name]
    by_color = values.new_tensor(factors)
    tensors[name] = values * (by_color[:, None] if rows else by_color)


def _take_back(tensors: dict[str, Tensor], name: str, first: int, factors: Rgb) -> None:
    """A first layer that sees base colours in its inputs from ``first`` on sees them as they were."""
    weight = tensors[name].clone()
    weight[:, first : first + 3] /= weight.new_tensor(factors)
    tensors[name] = weight


def _group(value: object) -> dict[str, object]:
    assert isinstance(value, dict)
    return value


def _unknown(model: SplatModel) -> RecipeError:
    return RecipeError(
        "this model's light cannot be edited; that of harmonics, shared bases, rings and mirrors can (3dgs, "
        "glossy-gaussian, light-gaussian, ringlight-basis, ringlight-ring, ringlight-mirror)"
    )


def _harmonics(color: ColorModel) -> SphericalHarmonics | None:
    """What the colours are, all of them; None where they are made otherwise."""
    if isinstance(color, GlossyHarmonics):
        return color.harmonic
    return color if isinstance(color, SphericalHarmonics) else None
