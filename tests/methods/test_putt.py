"""putt: sizes that decide ranks, grids that double, and settings that cannot be."""

from dataclasses import replace
from itertools import pairwise

import pytest
import torch

from ringlight.core.rendering import Rendering
from ringlight.core.want import Want
from ringlight.errors import ModelFileError, RecipeError
from ringlight.fit import room
from ringlight.fit.strategies.average_at_end import AverageAtEnd
from ringlight.fit.train import train
from ringlight.methods.putt import PuttRecipe
from ringlight.methods.putt_sizes import numbers_of_both
from ringlight.methods.recipe import recipe_from_dict, recipe_to_dict
from ringlight.methods.store import load_model, model_header, save_model, scene_facts
from ringlight.methods.tensorf import TensorfRecipe
from ringlight.rasterize.choose import rasterizer_for
from ringlight.volume.occupancy import cells_of
from small_recipes import small
from spoiled_volumes import assert_refused_without_its_end
from tiny_scene import tiny_scene

SCENE = tiny_scene(views=6, size=20)


def built(seed: int = 3, **settings):
    return small("putt", **settings).build(SCENE, rasterizer_for("cpu"), seed)


def test_its_ranks_are_the_papers_or_what_megabytes_hold():
    assert PuttRecipe().ranks == (200, 280)
    for size in (7.0, 12.0):
        recipe = PuttRecipe(size=size)
        density, appearance = recipe.ranks
        assert density / appearance == pytest.approx(200 / 280, abs=0.02)
        with torch.device("meta"):
            model = recipe.model_of(256, torch.tensor([[-1.0] * 3, [1.0] * 3]))
        of_bits = 160**3 // 8
        taken = sum(p.numel() * p.element_size() for p in model.parameters()) + of_bits
        assert 0.92 * size * 1e6 < taken <= size * 1e6


def test_its_grid_doubles_to_the_side_that_it_says():
    recipe = PuttRecipe(steps=30_000)
    assert recipe.refined == {250: 32.0**3, 500: 64.0**3, 2000: 128.0**3, 10_000: 256.0**3}
    assert recipe.emptied == (13_500, 16_500)
    assert list(PuttRecipe(steps=30_000, finest=64).refined) == [2000, 10_000]
    assert list(PuttRecipe(steps=30_000, last_doubling=0.0).refined) == [250, 500, 2000, 4000]
    assert list(PuttRecipe(steps=30_000, last_doubling=0.5).refined) == [250, 500, 2000, 15_000]
    assert list(PuttRecipe(steps=30_000, last_doubling=0.1).refined) == [250, 500, 2000, 4000]
    assert list(PuttRecipe(steps=3000, last_doubling=0.5, finest=32).refined) == [1500]
    assert not PuttRecipe(last_doubling=0.5, finest=16).refined
    many = PuttRecipe(steps=30_000, coarsest=4, finest=1024)
    assert list(many.refined) == [250, 500, 2000, 4000, 6000, 8000, 10_000, 12_000]
    assert list(replace(many, last_doubling=0.75).refined)[-2:] == [10_000, 22_500]
    training = built(steps=40, coarsest=4, finest=16)
    sides = []
    for _ in train(training):
        sides.append(training.model.field.sides[0])
    assert sorted(set(sides)) == [4, 8, 16]
    assert training.model.counted().number == 16**3
    assert training.batches.kept_rays < training.batches.all_rays


@pytest.mark.parametrize(
    ("steps", "rate"),
    [(50, 0.03), (150, 8e-4 * (80_000 / 150) ** 0.5), (3000, 8e-3), (15_000, 3.7e-3), (80_000, 1.6e-3)],
)
def test_the_longer_a_run_is_the_lower_is_its_rate(steps, rate):
    assert PuttRecipe(steps=steps).first_rate == pytest.approx(rate, rel=2e-3)


def test_its_rate_rises_at_first_is_set_back_and_settles_where_no_models_are_averaged():
    averaging = PuttRecipe(steps=30_000, rate=1.0).groups()["field.*"].rate
    rate = PuttRecipe(steps=30_000, rate=1.0, average=0.0).groups()["field.*"].rate
    assert averaging.at(1.0) == pytest.approx(0.2 ** (20 / 30))
    assert rate.at(0.0) == pytest.approx(0.1)
    assert rate.at(101 / 30_000) == pytest.approx(1.0, rel=1e-3)
    assert rate.at(9999 / 30_000) < 0.7
    assert rate.at(10_001 / 30_000) == pytest.approx(1.0, rel=1e-3)
    assert rate.at(0.8) == pytest.approx(0.07 ** (14 / 30))
    assert rate.at(0.9) == pytest.approx((0.07 ** (14 / 30) * 0.01) ** 0.5)
    assert rate.at(1.0) == pytest.approx(0.01)
    latest = PuttRecipe(steps=30_000, rate=1.0, average=0.0, last_doubling=0.75).groups()["field.*"].rate
    assert latest.at(1.0) == pytest.approx(0.01)


def test_its_network_is_twice_as_wide_as_the_papers_and_learns_four_times_as_fast():
    recipe = PuttRecipe()
    assert (recipe.hidden, recipe.groups()["*"].rate.at(recipe.network_rises_over)) == (256, pytest.approx(4e-3))


def test_the_networks_rate_rises_for_longer_through_the_first_doublings():
    recipe = PuttRecipe(steps=30_000, network_rate=1.0, network_warm_up=1 / 75)
    assert list(recipe.refined)[:2] == [250, 500]
    rate = recipe.groups()["*"].rate
    assert rate.at(0.0) == pytest.approx(0.1)
    rising = [rate.at(step / 30_000) for step in range(0, 401, 50)]
    assert all(after > 1.2 * before for before, after in pairwise(rising))
    assert rate.at(400 / 30_000) == pytest.approx(1.0)
    assert rate.at(499 / 30_000) < rate.at(401 / 30_000) < rate.at(501 / 30_000) == pytest.approx(1.0, rel=1e-3)


def test_the_models_of_its_last_tenth_are_averaged_and_of_older_recipes_none():
    assert PuttRecipe(steps=15_000).averaged_from == 13_501
    assert PuttRecipe(steps=15_000, average=1.0).averaged_from == 8251
    assert PuttRecipe(steps=15_000, average=0.0).averaged_from is None
    strategies = built(steps=40, average=0.25).strategies
    [built_for] = [strategy for strategy in strategies if isinstance(strategy, AverageAtEnd)]
    assert (built_for.first, built_for.last) == (31, 40)
    written = recipe_to_dict(PuttRecipe())
    del written["average"]
    assert recipe_from_dict(PuttRecipe, written).average == 0


@pytest.mark.parametrize(
    ("lengths", "sides"),
    [
        ((1.0, 1.0, 1.0), (16, 16, 16)),
        ((1.0, 1.4, 1.2), (16, 16, 16)),
        ((1.0, 1.6, 1.2), (16, 32, 16)),
        ((9.0, 1.0, 1.6), (32, 16, 32)),
    ],
)
def test_long_axes_of_its_box_have_twice_the_nodes(lengths: tuple[float, ...], sides: tuple[int, ...], tmp_path):
    bounds = (0.0, 0.0, 0.0, *lengths)
    recipe = small("putt", steps=40, coarsest=4, finest=16, bounds=bounds)
    training = recipe.build(SCENE, rasterizer_for("cpu"), 3)
    assert training.model.field.sides == tuple(side // 4 for side in sides)
    for _ in train(training):
        pass
    assert training.model.field.sides == sides
    cores = [p for p in training.model.field.parameters() if p.shape != (1, 8, 1)]
    numbers = numbers_of_both(recipe.features, 4, recipe.ranks, len(recipe.long_axes))
    assert sum(core.numel() for core in cores) == numbers
    header = model_header("putt", recipe, 40, scene_facts(SCENE))
    save_model(tmp_path / "model.safetensors", training.model, header, ())
    read = load_model(tmp_path / "model.safetensors", rasterizer_for("cpu")).model
    camera = SCENE.test[0].camera
    shown, again = (model.render(camera, SCENE.background_color, Want.EXACT).color for model in (training.model, read))
    assert torch.equal(shown, again)
    assert recipe.in_words(16) == ("16 cubed" if len(set(sides)) == 1 else " x ".join(map(str, sides)))


def test_older_recipes_have_as_many_nodes_along_each_axis():
    written = recipe_to_dict(PuttRecipe(bounds=(0.0, 0.0, 0.0, 1.0, 2.0, 1.0)))
    assert recipe_from_dict(PuttRecipe, written).long_axes == (1,)
    del written["even_voxels"]
    assert recipe_from_dict(PuttRecipe, written).long_axes == ()


ONE_LONG, TWO_LONG = (0.0, 0.0, 0.0, 1.0, 2.0, 1.0), (0.0, 0.0, 0.0, 1.5, 1.5, 1.0)


@pytest.mark.parametrize(("finest", "size"), [(64, 2.0), (64, 4.0), (128, 2.99), (128, 7.0), (256, 7.0), (256, 12.0)])
@pytest.mark.parametrize("bounds", [ONE_LONG, TWO_LONG])
def test_a_size_is_that_of_a_grid_with_long_axes_too(bounds, finest: int, size: float):
    """With bits for all cells."""
    recipe, box = PuttRecipe(size=size, finest=finest, bounds=bounds), torch.tensor([bounds[:3], bounds[3:]])
    with torch.device("meta"):
        model = recipe.model_of(finest, box)
    x, y, z = cells_of(box, recipe.longest_side)
    taken = sum(p.numel() * p.element_size() for p in model.parameters()) + x * y * z // 8
    assert 0.8 * size * 1e6 < taken <= size * 1e6


def test_a_run_goes_on_as_the_recipe_that_it_settled_on():
    settled = PuttRecipe(size=12.0, bounds=TWO_LONG)
    assert PuttRecipe(size=12.0).may_settle_on(settled)
    assert not PuttRecipe(size=12.0, bounds=ONE_LONG).may_settle_on(settled)
    too_large_for_a_cube = PuttRecipe(size=153.13, bounds=TWO_LONG)
    assert not PuttRecipe().may_settle_on(too_large_for_a_cube)


def test_axes_do_not_get_more_nodes_than_there_may_be(monkeypatch: pytest.MonkeyPatch):
    largest = PuttRecipe(finest=1024, bounds=TWO_LONG)
    assert largest.long_axes == ()
    assert largest.in_words(1024) == "1024 cubed"
    assert PuttRecipe(finest=512, bounds=TWO_LONG).in_words(512) == "1024 x 1024 x 512"
    box = torch.tensor([TWO_LONG[:3], TWO_LONG[3:]])
    assert largest.numbers_at(box, 512) == PuttRecipe(finest=512, bounds=TWO_LONG).numbers_at(box, 512)
    monkeypatch.setattr(room, "machine_memory", lambda: 6_000_000_000)
    with pytest.raises(RecipeError, match="give --finest 256 or less"):
        built(finest=1024, bounds=TWO_LONG)
    with pytest.raises(RecipeError, match="a grid of 1024 x 1024 x 512 takes"):
        built(finest=512, bounds=TWO_LONG)


def test_sizes_that_long_axes_leave_no_room_for_are_refused():
    least = PuttRecipe(size=4.0, finest=64).sizes.range[0]
    with pytest.raises(RecipeError, match="trains of 64 x 128 x 64 and their network take"):
        replace(PuttRecipe(size=least, finest=64), bounds=ONE_LONG)


@pytest.mark.parametrize("axes", [[2, 2], [3, 1], [1, 0]])
def test_a_file_says_which_axes_are_long(axes: list[int], tmp_path):
    recipe = small("putt", steps=4, coarsest=4, finest=16, bounds=TWO_LONG)
    model = recipe.build(SCENE, rasterizer_for("cpu"), 3).model
    path = tmp_path / "model.safetensors"
    for told in (recipe, replace(recipe, bounds=None)):  # before its first doubling; of a recipe that was not settled
        save_model(path, model, model_header("putt", told, 4, scene_facts(SCENE)), ())
        assert load_model(path, rasterizer_for("cpu")).model.field.sides == (8, 8, 4)
    model.field.long_axes = torch.tensor(axes, dtype=torch.uint8)
    save_model(path, model, model_header("putt", recipe, 4, scene_facts(SCENE)), ())
    with pytest.raises(ModelFileError, match="axes are 0, 1 and 2"):
        load_model(path, rasterizer_for("cpu"))


def test_rays_of_older_recipes_are_drawn_evenly():
    written = recipe_to_dict(PuttRecipe())
    assert written.pop("by_error") > 0
    assert recipe_from_dict(PuttRecipe, written).by_error == 0


@pytest.mark.parametrize("steps", [50, 3000, 4444, 15_000])
def test_older_recipes_find_empty_space_as_early_as_tensorf(steps: int):
    written = recipe_to_dict(PuttRecipe(steps=steps))
    del written["empty_at"]
    assert recipe_from_dict(PuttRecipe, written).emptied == TensorfRecipe(steps=steps).emptied


def test_steps_of_older_recipes_are_not_scaled_or_from_the_first_one_on():
    written = recipe_to_dict(PuttRecipe(scaled=0.6))
    del written["scaled_after"]
    older = recipe_from_dict(PuttRecipe, written)
    assert (older.scaled, older.scaled_after) == (0.6, 0)
    del written["scaled"]
    assert recipe_from_dict(PuttRecipe, written).scaled == 0


def test_how_steps_are_scaled_decides_nothing_where_none_are():
    assert PuttRecipe(scaled=0.0).without_effect().keys() == {"scaled_after", "orthogonal"}
    assert not PuttRecipe().without_effect()


def test_older_recipes_double_where_the_paper_does():
    written = recipe_to_dict(PuttRecipe())
    for name in ("last_doubling", "empty_at", "orthogonal"):
        del written[name]
    older = recipe_from_dict(PuttRecipe, written)
    assert list(older.refined) == [125, 250, 1000, 2000]
    assert older.emptied == (1000, 2000)
    assert not older.orthogonal


def test_steps_of_older_recipes_are_adams():
    written = recipe_to_dict(PuttRecipe(orthogonal=True))
    assert written.pop("orthogonal")
    assert not recipe_from_dict(PuttRecipe, written).orthogonal


def test_a_grid_that_memory_cannot_hold_is_refused_with_the_largest_that_can(monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setattr(room, "machine_memory", lambda: 400_000_000)
    with pytest.raises(RecipeError, match=r"a grid of 256 cubed takes .* MB .* give --finest (\d+) or less") as caught:
        built(finest=256)
    fits = int(str(caught.value).split("--finest ")[1].split()[0])
    built(finest=fits)
    with pytest.raises(RecipeError):
        built(finest=2 * fits)


@pytest.mark.parametrize(
    ("settings", "words"),
    [
        ({"rays": 0}, "rays is 0; give 1"),
        ({"density_rank": 1}, "density_rank is 1; give 2"),
        ({"appearance_rank": 10**9}, "appearance_rank is 1000000000; give 2 to"),
        ({"coarsest": 2}, "coarsest is 2; give 4"),
        ({"finest": 300}, "finest is 300; give a power of two, such as 256 or 512"),
        ({"finest": 8}, "finest is 8, below coarsest, 16"),
        ({"size": 0.0}, "size is 0; trains of 256 cubed and their network take 0.97 to"),
        ({"size": float("nan")}, "size is nan"),
        ({"size": 12.0, "finest": 32}, "take 0.45 to 5.38 megabytes; give one of these, such as 5.38"),
        ({"size": 2.0, "finest": 16}, "take 0.44 to 1.1 megabytes; give one of these, such as 1.1"),
        ({"size": 1e9}, "give one of these, such as 12"),
        ({"size": 12.0, "density_rank": 100}, "size and density_rank are given"),
        ({"gradient_share": float("nan")}, "gradient_share is nan"),
        ({"average": 1.5}, "average is 1.5; give a share"),
        ({"by_error": 1.0}, "by_error is 1; give 0"),
        ({"by_error": float("nan")}, "by_error is nan; give 0"),
        ({"scaled": 1.0}, "scaled is 1; give 0"),
        ({"empty_at": (0.4, 0.2)}, "empty_at is 0.4 0.2; give two shares of a run that rise"),
        ({"empty_at": (0.0, 0.2)}, "empty_at is 0 0.2"),
        ({"empty_at": (0.2, 1.0)}, "empty_at is 0.2 1"),
        ({"empty_at": (0.2, float("nan"))}, "empty_at is 0.2 nan"),
        ({"last_doubling": 0.9}, "last_doubling is 0.9; give 0 (the paper's) to 0.75"),
        ({"last_doubling": float("nan")}, "last_doubling is nan; give 0"),
        ({"l1": float("inf")}, "l1 is inf"),
        ({"tv_appearance": -1.0}, "tv_appearance is -1; give 0 (none) or more"),
        ({"decay": -0.1}, "decay is -0.1; give 0 (none) or more"),
        ({"decay": float("nan")}, "decay is nan; give 0"),
        ({"decay": 100.0, "rate": 0.01}, "decay is 100; give less than 1 / rate, 100,"),
        ({"decay": float("inf"), "rate": 0.0}, "decay is inf; give 0"),
        ({"rate": -1.0}, "rate is -1"),
        ({"bounds": (0.0, 0.0, 0.0, 1.0, 0.0, 1.0)}, "bounds are 0 0 0 1 0 1; give the lowest corner"),
    ],
)
def test_settings_that_cannot_be_are_refused_in_a_sentence(settings: dict, words: str):
    with pytest.raises(RecipeError) as caught:
        PuttRecipe(**settings)
    assert words in str(caught.value)
    assert "\n" not in str(caught.value)


def test_variation_of_appearance_is_a_term_where_it_is_asked_for():
    asked, plain = (built(steps=20, tv_appearance=weight, l1=0.0) for weight in (0.25, 0.0))
    term, shown = asked.regularizers["tv_appearance"], Rendering(torch.zeros(0, 3), torch.zeros(0, 1))
    assert not plain.regularizers
    first, again = (term.term(4, asked.model, shown).value for _ in range(2))
    assert torch.equal(first, again)
    assert not torch.equal(
        first,
        built(seed=4, steps=20, tv_appearance=0.25).regularizers["tv_appearance"].term(4, asked.model, shown).value,
    )


def test_decay_makes_the_cores_that_are_reached_smaller():
    kept, decayed = (built(steps=20, coarsest=8, finest=16, decay=decay) for decay in (0.0, 20.0))
    for training in (kept, decayed):
        next(train(training))
    for (name, one), other in zip(kept.model.named_parameters(), decayed.model.parameters(), strict=True):
        if name.startswith("field.") and ".cores.3" not in name:
            assert other.norm() < one.norm(), name
        else:
            assert torch.equal(other, one), name


def test_what_a_run_shows_is_much_the_same_after_its_grid_was_doubled():
    training = built(steps=60, coarsest=8, finest=16, density_rank=20, appearance_rank=30)
    model, camera = training.model, SCENE.test[0].camera
    steps = train(training)
    while model.field.sides[0] == 8:
        before = model.render(camera, SCENE.background_color, Want.EXACT).color
        next(steps)
    after = model.render(camera, SCENE.background_color, Want.EXACT).color
    assert (after - before).abs().mean() < 0.05


@pytest.mark.parametrize(
    "name", ["field.density_train.cores.1", "field.appearance_train.cores.0", "field.density_train.cores.3", "occupied"]
)
def test_a_file_whose_cores_do_not_fit_each_other_is_refused(name: str, tmp_path):
    assert_refused_without_its_end("putt", built(), SCENE, name, tmp_path / "model.safetensors")
