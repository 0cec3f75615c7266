"""The matrices of the studies: what each variant changes, and only that."""

import dataclasses
from typing import Any

import pytest

from ringlight.errors import RecipeError
from ringlight.methods.recipe import recipe_from_dict, recipe_to_dict
from ringlight.methods.studies import BASES, FULL, STUDIES, study_named
from ringlight.methods.table import METHODS
from ringlight.rasterize.choose import rasterizer_for
from tiny_scene import tiny_scene


def differences(one: Any, other: Any, where: str = "") -> set[str]:
    """Dotted names of the settings in which two recipes of a kind differ."""
    found: set[str] = set()
    for field in dataclasses.fields(one):
        ours, theirs = getattr(one, field.name), getattr(other, field.name)
        name = f"{where}{field.name}"
        if dataclasses.is_dataclass(ours):
            found |= differences(ours, theirs, f"{name}.")
        elif ours != theirs:
            found.add(name)
    return found


def changes(study: str, base: str) -> dict[str, set[str]]:
    """From the preset in a run of its own length."""
    variants = study_named(study, base, None)
    return {variant.name: differences(METHODS[variant.preset].at_length(), variant.recipe) for variant in variants}


@pytest.mark.parametrize("study", STUDIES)
@pytest.mark.parametrize("base", BASES)
def test_every_variant_is_a_run_that_train_could_make(study: str, base: str) -> None:
    variants = study_named(study, base, 70)
    assert variants[0].name == FULL
    assert variants[0].recipe == dataclasses.replace(METHODS[base], steps=70).at_length()
    names = [variant.name for variant in variants]
    assert len(set(names)) == len(names) > 2
    for variant in variants:
        assert variant.recipe.steps == 70
        assert type(variant.recipe) is type(METHODS[variant.preset])
        assert recipe_from_dict(type(variant.recipe), recipe_to_dict(variant.recipe)) == variant.recipe
        assert variant.as_many_as in (None, *names)
        settled, _ = variant.recipe.settled(tiny_scene(), rasterizer_for("auto"), 0)
        assert settled == variant.recipe  # or a study would not know its own runs again


def test_the_ablations_change_one_thing() -> None:
    rates = {"field_rate", "field_rate_end"}
    assert changes("ablation", "ringlight-paper") == {
        "full": set(),
        "discrete": {"light.field"},
        "discrete-grid-rate": {"light.field", *rates},
        "mlp": {"light.field"},
        "mlp-matched": {"light.field", "light.mlp.hidden"},
        "no-base-color": {"light.base_color"},
        "no-modulation": {"light.light_modulation"},
        "3dgs": set(),
        "3dgs-loss": {"loss.pixel"},
        "3dgs-equal": {"loss.pixel", "densify.threshold"},
    }


@pytest.mark.parametrize(
    ("study", "setting"),
    [
        ("rank", "light.ring.rank"),
        ("feature", "light.ring.features"),
        ("warmup", "warmup"),
        ("beta", "loss.ssim_weight"),
    ],
)
@pytest.mark.parametrize("base", BASES)
def test_a_varied_number_is_the_only_change(study: str, setting: str, base: str) -> None:
    assert all(found == ({setting} if name != FULL else set()) for name, found in changes(study, base).items())
    values = [variant.at for variant in study_named(study, base, None)]
    assert None not in values
    assert len(set(values)) == len(values)


@pytest.mark.parametrize("own", ["ring", "cp"])
def test_the_bases_own_field_is_not_run_twice(own: str, monkeypatch: pytest.MonkeyPatch) -> None:
    recipe = BASES["ringlight-ring"]
    changed = dataclasses.replace(recipe, light=dataclasses.replace(recipe.light, field=own))
    monkeypatch.setitem(BASES, "ringlight-ring", changed)
    variants = study_named("field", "ringlight-ring", None)
    fields = [variant.recipe.light.field for variant in variants]
    assert fields[0] == own
    assert sorted(fields) == sorted(["ring", "discrete", "cp", "tt", "vm", "mlp"])
    assert {"ring": "neural", "cp": "diagonal"}[own] in variants[0].about


def test_the_papers_numbers_are_beside_their_settings() -> None:
    ranks = {variant.at: variant.paper for variant in study_named("rank", "ringlight-paper", None)}
    assert ranks == {4: 27.71, 8: 28.94, 16: 29.01, 24: 29.10}
    features = {variant.at: variant.paper for variant in study_named("feature", "ringlight-ring", None)}
    assert features == {12: 28.42, 24: 28.93, 48: 29.01, 60: 29.20}


def test_the_threshold_goes_with_gamma() -> None:
    for base in BASES:
        shares = {v.recipe.densify.threshold / v.recipe.loss.scale for v in study_named("gamma", base, None)}
        assert max(shares) / min(shares) == pytest.approx(1)


def test_unknown_names_are_answered() -> None:
    with pytest.raises(RecipeError, match="perhaps you meant 'ablation'"):
        study_named("ablations", "ringlight-ring", None)
    with pytest.raises(RecipeError, match="no light field to study; give ringlight-paper or ringlight-ring"):
        study_named("rank", "3dgs", None)
