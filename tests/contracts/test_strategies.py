"""What every strategy of Gaussians must do, parametrised over all of them and the plug; those of volumes:
fit/strategies/test_volume_strategies.py."""

from collections.abc import Callable, Mapping
from dataclasses import replace
from typing import Literal

import pytest
import torch
from torch import Tensor

from contracts.methods import GROWING, small
from plugs.relocate import Relocate
from ringlight.core.camera import Camera
from ringlight.core.scene import Scene
from ringlight.fit.strategies.average_at_end import AverageAtEnd
from ringlight.fit.strategies.contract import Strategy
from ringlight.fit.strategies.densify import Densify
from ringlight.fit.strategies.densify_settings import DensifySettings
from ringlight.fit.strategies.drop_insignificant import DropInsignificant
from ringlight.fit.strategies.drop_least import DropLeast
from ringlight.fit.strategies.global_significance import global_significance
from ringlight.fit.strategies.mcmc import MCMC
from ringlight.fit.strategies.propagate_normals import PropagateNormals
from ringlight.fit.strategies.propagation_settings import PropagationSettings
from ringlight.fit.strategies.prune import Prune
from ringlight.fit.strategies.quantize_colors import QuantizeColors
from ringlight.fit.strategies.unlock import Unlock
from ringlight.fit.train import Training, train
from ringlight.rasterize.choose import rasterizer_for
from tiny_scene import tiny_scene

STEPS, HALF = 30, 13

SETTINGS = DensifySettings(**GROWING)
MOVING = DensifySettings(kind="mcmc", **GROWING)
DROPPING = DensifySettings(begin=0, every=2, stop=0.4, drop_share=0.5, drop_until=0.8)


def dropping(scene: Scene, by: Literal["weights", "effects"]) -> DropLeast:
    cameras = [view.camera for view in scene.train]
    return DropLeast(replace(DROPPING, drop_by=by), cameras, STEPS, scene.background_color, 3)


def moving(scene: Scene) -> MCMC:
    cameras = [view.camera for view in scene.train]
    return MCMC(MOVING, scene.extent, cameras, scene.background_color, STEPS, 3)


def cameras_of(scene: Scene) -> list[Camera]:
    return [view.camera for view in scene.train]


def rounded_to_half(columns: Mapping[str, Tensor]) -> dict[str, Tensor]:
    return {name: column.half().float() for name, column in columns.items()}


STRATEGIES: dict[str, Callable[[Scene], Strategy]] = {
    "densify": lambda scene: Densify(SETTINGS, scene.extent, STEPS, 3, white=True),
    "mcmc": moving,
    "drop least": lambda scene: dropping(scene, "weights"),
    "drop what changes least": lambda scene: dropping(scene, "effects"),
    "drop insignificant": lambda scene: DropInsignificant(
        (7, 15), 0.6, lambda model, step: global_significance(model, cameras_of(scene), 0.1)
    ),
    "quantize": lambda scene: QuantizeColors(STEPS, 0.6, 8, cameras_of(scene), 0.1, rounded_to_half, 3),
    "prune": lambda scene: Prune(begin=4, every=3, opacity=0.1),
    "unlock": lambda scene: Unlock("color.active_degree", {5: 1, 12: 2, 20: 3}),
    "propagate normals": lambda scene: PropagateNormals(PropagationSettings(), (4, 20), {9}.__contains__, seed=3),
    "average": lambda scene: AverageAtEnd(HALF - 3, STEPS - 2),
    "plug: relocate": lambda scene: Relocate(every=4, noise=1e-3, seed=3),
}

METHOD_OF = {"propagate normals": "3dgs-dr"}
"""Of strategies that know the columns of one method."""

pytestmark = [pytest.mark.parametrize("name", STRATEGIES)]


def training_of(name: str) -> Training:
    """3DGS, or what else it is made for, with this strategy alone; a third of its Gaussians nearly transparent."""
    scene = tiny_scene(views=6, size=24)
    training = small(METHOD_OF.get(name, "3dgs"), STEPS).build(scene, rasterizer_for("auto"), 3)
    training.strategies = (STRATEGIES[name](scene),)
    with torch.no_grad():
        training.model.get_parameter("columns.opacity_logits")[::3] = -5.5
    return training


def finish(training: Training) -> dict[str, Tensor]:
    for progress in train(training):
        assert progress.fault is None
    return {name: tensor.clone() for name, tensor in training.state().items()}


def same(one: dict[str, Tensor], other: dict[str, Tensor]) -> bool:
    return one.keys() == other.keys() and all(torch.equal(one[name], other[name]) for name in one)


def test_it_changes_something_and_leaves_all_finite(name: str):
    training, without = training_of(name), training_of(name)
    assert isinstance(training.strategies[0], Strategy)
    without.strategies = ()
    changed, plain = finish(training), finish(without)
    assert any(changed[n].shape != plain[n].shape or not torch.equal(changed[n], plain[n]) for n in plain)
    assert all(tensor.isfinite().all() for tensor in changed.values() if tensor.is_floating_point())


def test_every_column_and_its_moments_keep_the_tables_rows(name: str):
    training = training_of(name)
    most, first_rows = training.strategies[0].most, training.model.counted().number
    for _ in train(training):
        rows = training.model.counted().number
        assert rows > 0
        tensors = training.model.state_dict() | training.optimizer.moments
        columns = {n: t for n, t in tensors.items() if "columns." in n}
        assert len(columns) == 3 * len([n for n in tensors if n.startswith("columns.")])
        assert all(len(tensor) == rows for tensor in columns.values())
        assert most is None or rows <= max(most, first_rows)


def test_the_same_seed_gives_the_same_bits(name: str):
    assert same(finish(training_of(name)), finish(training_of(name)))


def test_what_it_counts_resumes_to_the_bit(name: str):
    whole, halfway = training_of(name), dict[str, Tensor]()
    for progress in train(whole):
        if progress.step == HALF:
            halfway = {n: tensor.clone() for n, tensor in whole.state().items()}
    resumed = training_of(name)
    resumed.restore(halfway)
    assert same(finish(resumed), whole.state())


def test_gradients_that_are_all_zero_are_no_trouble(name: str):
    """A photograph without a Gaussian in it."""
    training = training_of(name)
    with torch.no_grad():
        training.model.get_parameter("columns.means").add_(1000.0)
    assert all(tensor.isfinite().all() for tensor in finish(training).values() if tensor.is_floating_point())
