"""The reference: its gradients are those of finite differences, and what it shows is what an integral over space is."""

import math

import pytest
import torch

from contracts.differences import TOLERANCE, slopes_differ
from ringlight.core.want import Want
from ringlight.data.rays import Rays
from ringlight.volume.marching import END, entry_and_exit, marched, meets_box
from volume.volumes import BACKGROUND, BOX, rays, volume

COUNT = 5


def in_doubles(through: Rays) -> Rays:
    return Rays(through.origins.double(), through.directions.double(), through.jitter.double())


@pytest.mark.parametrize("output", ["color", "alpha", "depth"])
@pytest.mark.parametrize("kind", ["vm", "cp"])
def test_its_gradients_are_those_of_finite_differences(kind, output):
    model, through = volume(kind, (3, 4), hidden=8).double(), in_doubles(rays(COUNT))
    with torch.no_grad():  # of few components: slopes would be lost in the rounding of what is seen
        for name, parameter in model.field.named_parameters():
            parameter.mul_(6 if "appearance" in name else 2 if "density" in name else 1)
    space = model.space()
    drawn = torch.Generator().manual_seed(5)
    weights = torch.randn(COUNT, 3 if output == "color" else 1, generator=drawn)

    def value() -> torch.Tensor:
        shown = marched(through, space, model.density, model.color, BACKGROUND.double())
        return (weights * shown[output]).sum()

    leaves = {n: leaf for n, leaf in model.named_parameters() if output == "color" or "density" in n}
    found = torch.autograd.grad(value(), list(leaves.values()))
    differ = slopes_differ(value, leaves, dict(zip(leaves, found, strict=True)))
    assert {n: round(v, 7) for n, v in differ.items() if v > TOLERANCE} == {}


def test_even_fog_lets_through_what_its_thickness_says():
    """exp(-density * length), whatever the steps."""
    model = volume()
    model.occupied = torch.full((1, 1, 1), 255, dtype=torch.uint8)
    through, space = rays(50), model.space()
    near, far = entry_and_exit(through, BOX)
    density = 0.05
    shown = marched(
        through, space, lambda places: torch.full_like(places[:, 0], density), lambda places, _: places, BACKGROUND
    )
    length = (far - near).clamp_min(0)
    expected = 1 - torch.exp(-density * space.optical / space.step * length)
    one_step = density * space.optical  # where the last sample lies beyond the exit or not
    assert (shown["alpha"][:, 0] - expected).abs().max() < one_step


def test_what_lies_behind_something_opaque_is_not_looked_at():
    model, through = volume(), rays(30)
    looked_at = []

    def color(places, directions):
        looked_at.append(len(places))
        return places

    shown = marched(through, model.space(), lambda places: 1e3 + 0 * places[:, 0], color, BACKGROUND)
    met = int((shown["alpha"] > 0).sum())
    assert looked_at == [met]
    assert math.exp(-1e3 * model.space().optical) < END


def test_rays_meet_the_box_where_a_point_of_them_lies_in_it():
    through = rays(500)
    along = torch.linspace(0, 8, 4000)
    points = through.origins[:, None] + along[:, None] * through.directions[:, None]
    inside = ((points > BOX[0]) & (points < BOX[1])).all(-1).any(1)
    assert (inside != meets_box(through, BOX)).float().mean() < 0.01  # those that cut a corner


def test_pictures_in_parts_and_whole_have_the_same_bits():
    from tiny_scene import tiny_scene

    camera, model = tiny_scene(views=2, size=20).test[0].camera, volume()
    whole, parts = (model.render(camera, BACKGROUND, want) for want in (Want.GRADIENTS, Want.EXACT))
    assert torch.equal(whole.color, parts.color)
