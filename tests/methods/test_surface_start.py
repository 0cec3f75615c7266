"""Gaussians start on the visual hull where masks give one, and on the scene's points elsewhere."""

import dataclasses

import pytest
import torch

from ringlight.core.scene import Scene, View
from ringlight.errors import RecipeError
from ringlight.methods.ringlight_basis import RingLightBasisRecipe
from ringlight.methods.surface_start import FEWEST_FOR_DISCS, FEWEST_VIEWS, FIRST_GAUSSIANS, SurfaceStart
from ringlight.methods.three_dgs import ThreeDGSRecipe
from ringlight.rasterize.choose import rasterizer_for
from small_recipes import small
from tiny_scene import BALLS, tiny_scene

OF_HULL = SurfaceStart(points=500, form="discs")
IN_HULL = SurfaceStart(points=500)


def without_masks(scene: Scene) -> Scene:
    def opaque(view: View) -> View:
        return dataclasses.replace(view, load=lambda: view.load()[..., :3], has_alpha=False)

    return dataclasses.replace(scene, train=tuple(opaque(view) for view in scene.train))


def depth_in_balls(positions: torch.Tensor) -> torch.Tensor:
    """In the ball that is nearest to containing the point."""
    centers, radii = torch.from_numpy(BALLS[:, :3]).float(), torch.from_numpy(BALLS[:, 3]).float()
    return (radii - torch.cdist(positions, centers)).max(1).values


def test_points_of_the_hull_lie_around_the_balls_and_differ_by_seed():
    points = OF_HULL.points_in(tiny_scene(views=FEWEST_VIEWS), seed=0)
    assert points.positions.shape == (500, 3)
    assert points.normals is not None
    depth = depth_in_balls(points.positions)
    assert depth.quantile(0.05) > -0.35, "a hull of twelve views is somewhat wider than what it holds"
    assert depth.max() < 0.2, "no point lies deep inside"
    assert not torch.equal(points.positions, OF_HULL.points_in(tiny_scene(views=FEWEST_VIEWS), seed=1).positions)


def test_with_fewer_photographs_they_lie_anywhere_in_it():
    scene = tiny_scene(views=FEWEST_VIEWS)
    points = IN_HULL.points_in(scene, seed=0)
    assert points.positions.shape == (500, 3)
    assert points.normals is None
    depth = depth_in_balls(points.positions)
    assert depth.min() > -0.5, "as wide as the hull"
    assert (depth > 0.2).sum() > 50, "deep inside too"
    assert torch.equal(points.positions, IN_HULL.points_in(scene, seed=0).positions)
    assert not torch.equal(points.positions, IN_HULL.points_in(scene, seed=1).positions)
    table = RingLightBasisRecipe(steps=20).build(scene, rasterizer_for("auto"), 0).model.gaussians
    assert torch.allclose(table.opacities, torch.tensor(0.1))
    assert torch.equal(table.log_scales[:, 0], table.log_scales[:, 2]), "balls"


def test_a_run_says_in_which_form_it_starts():
    """And one that left it to the photographs knows either as its own."""
    scene, rasterize = tiny_scene(views=FEWEST_VIEWS), rasterizer_for("auto")
    many = dataclasses.replace(scene, train=(scene.train * FEWEST_FOR_DISCS)[:FEWEST_FOR_DISCS])
    fewer = dataclasses.replace(many, train=many.train[1:])
    for method in (RingLightBasisRecipe(steps=20), ThreeDGSRecipe(steps=20, start=IN_HULL)):
        forms = {}
        for of in (scene, fewer, many):
            settled, _ = method.settled(of, rasterize, 0)
            assert method.may_settle_on(settled)
            forms[len(of.train)] = settled.start.form
        assert forms == {FEWEST_VIEWS: "balls", FEWEST_FOR_DISCS - 1: "balls", FEWEST_FOR_DISCS: "discs"}
        asked = dataclasses.replace(method, start=OF_HULL)
        assert asked.settled(scene, rasterize, 0)[0].start == OF_HULL
        assert not asked.may_settle_on(method.settled(scene, rasterize, 0)[0])
    assert ThreeDGSRecipe(steps=20).settled(scene, rasterize, 0)[0].start.form == "discs", "as before there were balls"


@pytest.mark.parametrize("method", ["3dgs-dr", "gaussian-shader"])
@pytest.mark.parametrize("views", [FEWEST_VIEWS, FEWEST_VIEWS - 1])
def test_methods_that_mirror_at_normals_have_some_to_begin_with(method: str, views: int):
    """Also where photographs have no alpha, or are too few for a hull: of an even background, or of the points."""
    scene = without_masks(tiny_scene(views=views, size=24))
    table = (
        small(method, start=SurfaceStart(points=300, form="discs"))
        .build(scene, rasterizer_for("cpu"), 0)
        .model.gaussians
    )
    assert (table.log_scales.argmin(1) == 2).all(), "discs"
    assert not torch.equal(table.quats, table.quats[:1].expand_as(table.quats))
    assert (table.log_scales[:, 2] < table.log_scales[:, 0] - 0.5).all()
    with pytest.raises(RecipeError, match=r"start\.form is balls; a method that mirrors at normals starts from discs"):
        small(method, start=SurfaceStart(points=300, form="balls")).build(scene, rasterizer_for("cpu"), 0)
    paper = (
        small(method, start=SurfaceStart(points=0, form="discs")).build(scene, rasterizer_for("cpu"), 0).model.gaussians
    )
    assert len(paper) == len(scene.points.positions)
    assert torch.equal(paper.quats, paper.quats[:1].expand_as(paper.quats))


@pytest.mark.parametrize(
    ("start", "scene"),
    [
        (SurfaceStart(points=0), tiny_scene(views=FEWEST_VIEWS)),
        (OF_HULL, without_masks(tiny_scene(views=FEWEST_VIEWS))),
        (OF_HULL, tiny_scene(views=FEWEST_VIEWS - 1)),
        (OF_HULL, dataclasses.replace(tiny_scene(views=FEWEST_VIEWS), box=torch.full((2, 3), 100.0) + torch.eye(2, 3))),
    ],
    ids=["not asked for", "no masks", "few photographs", "masks that leave nothing"],
)
def test_without_a_hull_the_scenes_points_are_taken(start: SurfaceStart, scene: Scene):
    assert start.points_in(scene, seed=0) is scene.points


@pytest.mark.parametrize("recipe", [RingLightBasisRecipe(steps=20), ThreeDGSRecipe(steps=20)])
def test_gaussians_on_the_hull_are_discs_of_their_own_opacity(recipe: RingLightBasisRecipe | ThreeDGSRecipe):
    asked = dataclasses.replace(recipe, start=dataclasses.replace(OF_HULL, opacity=0.6))
    model = asked.build(tiny_scene(views=FEWEST_VIEWS), rasterizer_for("auto"), 0).model
    scales = model.get_parameter("columns.log_scales")
    assert torch.allclose(model.get_parameter("columns.opacity_logits").sigmoid(), torch.tensor(0.6))
    assert scales.shape == (500, 3)
    assert (scales[:, 2] < scales[:, 0]).all()


def test_the_basis_starts_on_the_hull_and_3dgs_on_the_scenes_points():
    scene = tiny_scene(views=FEWEST_VIEWS)

    def first(recipe: RingLightBasisRecipe | ThreeDGSRecipe) -> torch.Tensor:
        open_, settled = (one.build(scene, rasterizer_for("auto"), 0).model for one in (recipe, recipe.at_length()))
        assert open_.counted() == settled.counted()
        return open_.get_parameter("columns.opacity_logits").sigmoid()

    assert first(RingLightBasisRecipe(steps=30_000)).shape == (FIRST_GAUSSIANS,)
    of_3dgs = first(ThreeDGSRecipe(steps=30_000))
    assert of_3dgs.shape == (len(scene.points.positions),)
    assert torch.allclose(of_3dgs, torch.tensor(0.1))


@pytest.mark.parametrize("wrong", [{"points": -1}, {"opacity": 0.0}, {"opacity": 1.0}, {"opacity": float("nan")}])
def test_settings_out_of_range_are_refused(wrong: dict[str, float]):
    with pytest.raises(RecipeError, match=f"start.{next(iter(wrong))}"):
        SurfaceStart(**wrong)
