"""A condensed 3iGS model: the same colours from everywhere, by components of which the first show most."""

from dataclasses import replace

import pytest
import torch
from hypothesis import given, settings
from hypothesis import strategies as st

from contracts.plugged import BOX
from ringlight.color.condensed_illumination import (
    CODED,
    FEWEST,
    Condensed,
    condensed,
    condensed_settings,
    with_components,
    worth_keeping,
)
from ringlight.color.illuminated import FEATURES, Illuminated
from ringlight.color.illumination_settings import IlluminationSettings
from ringlight.core.gaussians import Gaussians
from ringlight.core.gradients import COLOR
from ringlight.core.scene import PointCloud
from tiny_scene import tiny_scene

SETTINGS = IlluminationSettings(side=6, components=3, features=5, hidden=16)

COUNT = 400


def model_and_table(light: IlluminationSettings, seed: int = 1, spread: float = 0.5) -> tuple[Illuminated, Gaussians]:
    """Networks as they start, planes and features as they are after a while."""
    model, noise = Illuminated(light, BOX, seed), torch.Generator().manual_seed(seed)
    low, high = BOX
    means = low + (high - low) * torch.rand(COUNT, 3, generator=noise)
    columns = model.new_columns(PointCloud(means, torch.rand(COUNT, 3, generator=noise)))
    columns[FEATURES] = spread * torch.randn(columns[FEATURES].shape, generator=noise)
    with torch.no_grad():
        for grids in (model.field.planes, model.field.lines):
            grids.mul_(100 * spread)
    return model, Gaussians(means, torch.full((COUNT, 3), -3.0), torch.randn(COUNT, 4), torch.zeros(COUNT), columns)


def shown(model: Illuminated, gaussians: Gaussians) -> torch.Tensor:
    """What the light adds, seen from a few sides."""
    cameras = [view.camera for view in tiny_scene().train][:4]
    with torch.no_grad():
        return torch.stack([model.specular_reference(gaussians, one, torch.arange(COUNT)) for one in cameras])


def rebuilt(model: Illuminated, gaussians: Gaussians, tensors: dict[str, torch.Tensor]) -> torch.Tensor:
    """What a model of these tensors adds."""
    less = Illuminated(condensed_settings(model.settings, tensors[CODED].shape[1]), model.box, seed=9)
    of_color = {name.removeprefix(COLOR): tensor for name, tensor in tensors.items() if name.startswith(COLOR)}
    less.load_state_dict({**model.state_dict(), **of_color})
    appearance = gaussians.appearance | {FEATURES: tensors[CODED]}
    return shown(less, replace(gaussians, appearance=appearance))


@settings(max_examples=15, deadline=None)
@given(
    features=st.integers(3, 12),
    hidden=st.integers(4, 24),
    seed=st.integers(0, 100),
    spread=st.sampled_from([0.0, 1e-3, 0.5, 5.0]),
)
def test_all_components_show_the_same(features: int, hidden: int, seed: int, spread: float) -> None:
    model, gaussians = model_and_table(replace(SETTINGS, features=features, hidden=hidden), seed, spread)
    found = condensed(model, gaussians).tensors
    assert found[CODED].shape == (COUNT, min(2 * features, hidden))
    torch.testing.assert_close(rebuilt(model, gaussians, found), shown(model, gaussians), rtol=0, atol=2e-5)


@pytest.fixture(scope="module")
def scene() -> tuple[Illuminated, Gaussians, Condensed]:
    model, gaussians = model_and_table(replace(SETTINGS, features=10, hidden=32))
    return model, gaussians, condensed(model, gaussians)


def test_the_first_components_show_most(scene: tuple[Illuminated, Gaussians, Condensed]) -> None:
    model, gaussians, found = scene
    wanted, off = shown(model, gaussians), []
    for kept in (3, 6, 10, 15):
        fewer = with_components(found.tensors, kept)
        assert fewer[CODED].shape == (COUNT, kept)
        off.append(float((rebuilt(model, gaussians, fewer) - wanted).square().mean()))
    assert off == sorted(off, reverse=True)
    least = with_components(found.tensors, 20)[CODED].square().mean(0)
    assert torch.equal(least, least.sort(descending=True).values)


def test_equal_steps_show_equally(scene: tuple[Illuminated, Gaussians, Condensed]) -> None:
    """Each component rounded alone changes colours by what a step's rounding should, whichever it is."""
    model, gaussians, found = scene
    wanted, step = shown(model, gaussians), 0.01
    for number in (0, 1, 3, 6):
        rounded = found.tensors[CODED].clone()
        rounded[:, number] = (rounded[:, number] / (found.unit * step)).round() * found.unit * step
        off = rebuilt(model, gaussians, found.tensors | {CODED: rounded}) - wanted
        by_color = off.square().sum(-1).mean().sqrt() / (step / 12**0.5)
        assert 0.3 < by_color < 2, number


def test_what_is_narrower_than_a_step_is_left_out(scene: tuple[Illuminated, Gaussians, Condensed]) -> None:
    _, _, found = scene
    features = found.tensors[CODED]
    widths = features.double().square().mean(0).sqrt()
    assert worth_keeping(features, float(widths[7])) > 7
    assert worth_keeping(features, float(widths[7]) * 3) <= 7
    assert worth_keeping(features, 1e9) == FEWEST
    assert worth_keeping(features, 0.0) == features.shape[1]
