"""What ``study pareto`` trains: equal density control, sizes by bytes, lengths that are halved."""

import dataclasses

import pytest

from ringlight.errors import RecipeError
from ringlight.methods.ringlight_basis import RingLightBasisRecipe
from ringlight.methods.studies import PARETO_BASES, STUDY_NAMES, study_named
from ringlight.methods.variant import Curve

DEGREES = [f"3dgs-degree-{degree}" for degree in range(4)]


@pytest.mark.parametrize("base", PARETO_BASES)
def test_every_method_has_five_sizes_and_five_lengths(base: str) -> None:
    variants = study_named("pareto", base, 1600)
    assert len({variant.name for variant in variants}) == len(variants) == 5 + 5 * 2 * 5
    for name in (base, *DEGREES):
        lengths = [v for v in variants if Curve(name, "length") in v.curves]
        assert [v.recipe.steps for v in lengths] == [100, 200, 400, 800, 1600]
        assert all(v.within is None for v in lengths)
        sizes = [v for v in variants if Curve(name, "size") in v.curves]
        assert [v.within and v.within.share for v in sizes] == [1 / 16, 1 / 8, 1 / 4, 1 / 2, 1]
        assert {v.recipe.steps for v in sizes} == {1600}
    assert {v.within.of for v in variants if v.within} == {"3dgs-steps-1600"}
    assert {v.preset for v in variants} == {base, "3dgs"}


def test_harmonics_of_all_degrees_grow_and_drop_alike() -> None:
    variants = [v for v in study_named("pareto", None, 3000) if v.name.startswith("3dgs-degree-")]
    without_degree = {dataclasses.replace(v.recipe, sh_degree=0) for v in variants if v.recipe.steps == 3000}
    assert len(without_degree) == 2, "eager where a size is to be filled"
    assert {r.rates for r in without_degree} == {RingLightBasisRecipe(steps=3000).at_length().rates}
    assert (
        len({dataclasses.replace(r, densify=dataclasses.replace(r.densify, threshold=1.0)) for r in without_degree})
        == 1
    )


def test_3dgs_as_it_is_stands_beside() -> None:
    plain = [v for v in study_named("pareto", None, None) if v.name.startswith("3dgs-steps")]
    assert [v.recipe.steps for v in plain] == [1875, 3750, 7500, 15000, 30000]
    assert all(v.recipe.densify.drop_share == 0 for v in plain)
    assert Curve("3dgs", "size") in plain[-1].curves


def test_short_runs_have_fewer_lengths() -> None:
    assert len([v for v in study_named("pareto", None, 2) if Curve("3dgs", "length") in v.curves]) == 2


def test_what_is_no_rival_of_3dgs_is_refused() -> None:
    assert "pareto" in STUDY_NAMES
    with pytest.raises(RecipeError, match="give ringlight-basis or ringlight-paper"):
        study_named("pareto", "3dgs", None)
    with pytest.raises(RecipeError, match="perhaps you meant 'pareto'"):
        study_named("paretto", None, None)
