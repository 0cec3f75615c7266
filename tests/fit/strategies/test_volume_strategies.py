"""Empty space is found and the grid refined at the steps that the recipe says, once, with Adam anew, and to the bit."""

from collections.abc import Callable

import pytest
import torch

from ringlight.core.rendering import Rendering
from ringlight.data.ray_errors import UNSEEN
from ringlight.fit.strategies.contract import Strategy
from ringlight.fit.strategies.draw_by_error import DrawByError
from ringlight.fit.strategies.empty_space import EmptySpace
from ringlight.fit.strategies.refine_grid import RefineGrid
from ringlight.fit.train import Training, train
from ringlight.rasterize.choose import rasterizer_for
from ringlight.volume.model import VolumeModel
from ringlight.volume.occupancy import unpacked
from small_recipes import small
from tiny_scene import tiny_scene

SCENE = tiny_scene(views=6, size=20)
WITH_MASKS = tiny_scene(views=12, size=48)
STEPS = 60
NOTHING = Rendering(torch.zeros(1, 3), torch.zeros(1, 1))
SCENE_RAYS = sum(view.camera.width * view.camera.height for view in SCENE.train)


def training_of(method: str) -> Training:
    """Its masks say nothing: what is empty, it has to find. It begins dense here and there."""
    settings = {} if method == "tensorf" else {"coarsest": 4, "finest": 16}
    training = small(method, steps=STEPS, carve=False, by_error=0.7, **settings).build(SCENE, rasterizer_for("cpu"), 3)
    with torch.no_grad():
        for name, parameter in training.model.named_parameters():
            if name.startswith("field.density_"):
                parameter.mul_(12)
    return training


def strategies_of(training: Training) -> tuple[EmptySpace, RefineGrid]:
    empty, refine = (next(s for s in training.strategies if isinstance(s, kind)) for kind in (EmptySpace, RefineGrid))
    assert isinstance(empty, Strategy)
    assert isinstance(refine, Strategy)
    return empty, refine


@pytest.mark.parametrize("method", ["tensorf", "putt"])
def test_each_happens_after_its_steps_and_never_else(method: str):
    training = training_of(method)
    empty, refine = strategies_of(training)
    assert 1 < empty.steps[0] < empty.steps[-1] < STEPS
    sides, bits, rays = training.model.nodes, training.model.occupied.clone(), training.batches.kept_rays
    assert bits.numel() == 1
    coarse, met = sides, rays
    for progress in train(training):
        step = progress.step
        at_refinement, at_look = step in refine.voxels, step in empty.steps
        assert (training.model.nodes != sides) <= (at_refinement or at_look)
        assert (not torch.equal(training.model.occupied, bits)) <= at_look
        assert (training.batches.kept_rays != rays) <= (step == empty.steps[-1])
        if at_refinement:
            assert not any(moments.any() for moments in training.optimizer.moments.values())
        sides, bits, rays = training.model.nodes, training.model.occupied.clone(), training.batches.kept_rays
    assert bits.numel() > 1
    assert all(fine > few for fine, few in zip(sides, coarse, strict=True))
    assert rays < met


@pytest.mark.parametrize("method", ["tensorf", "putt"])
@pytest.mark.parametrize("after", ["the first look", "all looks"])
def test_a_resumed_run_has_the_same_bits(method: str, after: str):
    whole, kept = training_of(method), dict[str, torch.Tensor]()
    half = strategies_of(whole)[0].steps[0 if after == "the first look" else -1] + 1
    for progress in train(whole):
        if progress.step == half:
            kept = {name: tensor.clone() for name, tensor in whole.state().items()}
    resumed = training_of(method)
    resumed.restore(kept)
    for _ in train(resumed):
        pass
    ends = resumed.state(), whole.state()
    assert ends[0].keys() == ends[1].keys()
    assert all(torch.equal(ends[0][name], ends[1][name]) for name in ends[0])
    assert resumed.batches.kept_rays == whole.batches.kept_rays


@pytest.mark.parametrize("method", ["tensorf", "putt"])
def test_what_is_not_learned_yet_is_not_taken_for_empty(method: str, monkeypatch: pytest.MonkeyPatch):
    """Of the subject one half is, and of the other nothing."""

    def half(model: VolumeModel, places: torch.Tensor) -> torch.Tensor:
        return torch.where(places[:, 0] < 0.5, 1e3, 0.0)

    monkeypatch.setattr(VolumeModel, "density_values", half)
    lost = []
    for masks_count in (True, False):
        training = small(method, steps=STEPS, carve=True).build(WITH_MASKS, rasterizer_for("cpu"), 0)
        empty, _ = strategies_of(training)
        if not masks_count:
            empty = EmptySpace(training.batches, empty.steps)
        model, batches = training.model, training.batches
        met = batches.shows_subject() & batches.looked_at(model.meets_something)
        cells = unpacked(model.occupied).sum()
        empty.update(empty.steps[0], model, training.optimizer, NOTHING)
        lost.append(int((met & ~batches.looked_at(model.meets_something)).sum()))
        assert met.any()
        assert not masks_count or unpacked(model.occupied).sum() < 1.5 * cells
    assert lost[0] == 0
    assert lost[1] > 100


@pytest.mark.parametrize("method", ["tensorf", "putt"])
def test_errors_are_those_of_the_rays_that_were_drawn(method: str):
    training = training_of(method)
    [by_error] = [strategy for strategy in training.strategies if isinstance(strategy, DrawByError)]
    assert isinstance(by_error, Strategy)
    shown = 0
    for progress in train(training):
        assert progress.weights is not None
        blocks = (by_error.errors.errors < UNSEEN).sum().item()
        assert shown < blocks or blocks > 0.9 * len(by_error.errors.errors)
        shown = blocks
    whole, even = training_of(method), small(method, steps=STEPS, by_error=0.0).build(SCENE, rasterizer_for("cpu"), 3)
    assert not any(isinstance(strategy, DrawByError) for strategy in even.strategies)
    assert even.batches.at(1).weights is None
    assert whole.batches.at(1).weights is not None


@pytest.mark.parametrize(
    ("change", "words"),
    [
        (lambda errors: errors[1:], "blocks of pixels have errors of float32"),
        (lambda errors: errors.double(), "not torch.float64"),
        (lambda errors: errors - 2, "numbers from 0 to 1"),
        (lambda errors: errors * float("nan"), "numbers from 0 to 1"),
    ],
)
def test_errors_that_photographs_cannot_have_are_refused(change: Callable[[torch.Tensor], torch.Tensor], words: str):
    training = training_of("tensorf")
    state = training.state()
    [name] = [name for name in state if name.endswith(".errors")]
    with pytest.raises(ValueError, match=words):
        training.restore(state | {name: change(state[name])})


@pytest.mark.parametrize("rays", [0, 8, SCENE_RAYS + 8])
def test_bits_that_say_nothing_of_these_rays_are_refused(rays: int):
    """Of a state that was made by hand: none drawn, and of other photographs."""
    empty, _ = strategies_of(training_of("tensorf"))
    bits = torch.ones(rays // 8, dtype=torch.uint8) if rays else torch.zeros(SCENE_RAYS // 8, dtype=torch.uint8)
    with pytest.raises(ValueError, match=f"say which of {SCENE_RAYS:,} rays are drawn"):
        empty.restore({"kept": bits})
    assert not len(empty.state()["kept"])


def test_where_no_ray_meets_anything_all_are_kept():
    training = training_of("tensorf")
    empty, _ = strategies_of(training)
    before = training.batches.kept_rays
    with torch.no_grad():
        for line in training.model.field.density_factors.lines:
            line.zero_()
    training.model.skip_all_but(torch.zeros(8, 8, 8, dtype=torch.bool))
    empty._filter(training.model)
    assert training.batches.kept_rays == before
    assert not len(empty.state()["kept"])
