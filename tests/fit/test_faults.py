"""What is not finite is named with step, view, parameter and row, and never gets into the model."""

import dataclasses

import pytest
import torch

from ringlight.core.gradients import Gradients, dense
from ringlight.core.scene import View
from ringlight.errors import BackendError, DivergedError, ModelFileError
from ringlight.files.model_file import write_model_file
from ringlight.fit.faults import MOST_IN_A_ROW
from ringlight.fit.train import Training, alone, train
from ringlight.methods.store import load_model, model_header, save_model, scene_facts, tensors_from_cameras
from ringlight.methods.table import METHODS
from ringlight.rasterize.choose import rasterizer_for
from small_recipes import small
from tiny_scene import tiny_scene

BAD = (float("nan"), float("inf"), -float("inf"))

FAMILIES = ("3dgs", "ringlight-basis", "ringlight-ring", "ringlight-mirror")
"""Of recipes: harmonics, light on Gaussians, light on pixels."""

VOLUMES = ("tensorf", "putt")
"""They keep photographs as bytes, which are numbers always, and read poses once, before the first step."""

BEFORE = dict.fromkeys(FAMILIES, 4) | dict.fromkeys(VOLUMES, 8)
"""Steps of twelve after which the light is on, the grid is as fine as it gets and steps are scaled."""


class BrokenView(View):
    """A photograph with one pixel that is no number, as a program of one's own may hand it over; files hold none."""

    def image(self, background: torch.Tensor) -> torch.Tensor:
        image = super().image(background)
        image[1, 3, 5] = float("nan")
        return image


def training_of(method: str = "3dgs", steps: int = 40, scene=None) -> Training:
    recipe = small(method, steps=steps) if method in VOLUMES else dataclasses.replace(METHODS[method], steps=steps)
    return recipe.build(scene or tiny_scene(views=4, size=16), rasterizer_for("auto"), seed=0)


def all_finite(training: Training) -> bool:
    return all(tensor.isfinite().all() for tensor in training.state().values() if tensor.is_floating_point())


def spoil_gradient(training: Training, name: str, bad: float, row: int, always: bool = False) -> None:
    """The parameter's gradient gets a bad number in the next step."""

    def spoil(gradients: Gradients) -> Gradients:
        spoiled = dense(gradients[name]).contiguous().clone()
        spoiled.view(len(spoiled), -1)[row, 0] = bad
        if not always:
            training.reduce = alone
        return Gradients(gradients | {name: spoiled})

    training.reduce = spoil


PARAMETERS = [
    (method, name)
    for method in (*FAMILIES, *VOLUMES)
    for name, parameter in training_of(method).model.named_parameters()
    if parameter.ndim > 0
]
SPOILED, OTHERWISE_SPOILED = (
    [(*pair, BAD[(index + first) % len(BAD)]) for index, pair in enumerate(PARAMETERS)] for first in (0, 1)
)
"""Each parameter meets one of the three in a test, each family all of them: to build a run takes most of the time."""


@pytest.mark.parametrize(("method", "name", "bad"), SPOILED)
def test_a_gradient_is_named_left_out_and_the_run_goes_on(method: str, name: str, bad: float) -> None:
    training = training_of(method, steps=12)
    steps = train(training)
    for _ in range(BEFORE[method]):
        next(steps)
    parameter = dict(training.model.named_parameters())[name]
    others = {other: p.detach().clone() for other, p in training.model.named_parameters() if other != name}
    row = len(parameter) - 1
    before = parameter.detach().clone()
    spoil_gradient(training, name, bad, row)
    progress = next(steps)
    assert progress.fault is not None
    for word in (f"step {progress.step}", progress.batch.label, name, f"row {row}"):
        assert word in progress.fault
    after = dict(training.model.named_parameters())[name]
    assert torch.equal(after.view(len(after), -1)[row, 0], before.view(len(before), -1)[row, 0])
    assert any(not torch.equal(p, others[other]) for other, p in training.model.named_parameters() if other != name)
    assert all_finite(training)
    assert next(steps).fault is None


@pytest.mark.parametrize("bad", BAD)
def test_a_gradient_that_is_never_written_down_is_left_out_too(bad: float) -> None:
    """That of the harmonics shares its factor with the constant coefficient's."""
    training = training_of("3dgs", steps=12)
    steps = train(training)
    next(steps)

    def spoil(gradients: Gradients) -> Gradients:
        assert not isinstance(gradients["columns.sh_rest"], torch.Tensor)
        dense(gradients["columns.sh_dc"])[-1, 0] = bad
        return gradients

    training.reduce = spoil
    before = {name: p.detach().clone() for name, p in training.model.named_parameters()}
    fault = next(steps).fault
    assert fault is not None
    assert "columns.sh_dc" in fault
    after = dict(training.model.named_parameters())
    assert torch.equal(after["columns.sh_rest"][-1, :, 0], before["columns.sh_rest"][-1, :, 0])
    assert not torch.equal(after["columns.opacity_logits"], before["columns.opacity_logits"])
    assert all_finite(training)


@pytest.mark.parametrize("method", FAMILIES)
def test_a_photograph_that_is_not_finite_is_named_each_time_and_changes_nothing(method: str) -> None:
    scene = tiny_scene(views=4, size=16)
    broken = BrokenView(**vars(scene.train[2]))
    training = training_of(method, scene=dataclasses.replace(scene, train=(*scene.train[:2], broken, *scene.train[3:])))
    faults = []
    for progress in train(training):
        if progress.fault is not None:
            faults.append(progress.fault)
            assert progress.batch.view is broken
            assert "photometric loss" in progress.fault
            assert broken.name in progress.fault
        if progress.step == 20:
            break
    assert len(faults) == 5, "once an epoch of four views"
    assert all_finite(training)


@pytest.mark.parametrize(("place", "bad"), list(zip([(0, 0), (2, 1), (1, 3)], BAD, strict=True)))
@pytest.mark.parametrize("method", FAMILIES)
def test_a_pose_that_is_not_finite_is_named_and_changes_nothing(
    method: str, place: tuple[int, int], bad: float
) -> None:
    """As a program of one's own may make it: loaders refuse such poses by image."""
    training = training_of(method, steps=12)
    steps = train(training)
    for _ in range(5):  # the light field is switched on
        next(steps)
    view = training.batches.at(6).view
    before = {name: tensor.clone() for name, tensor in training.state().items()}
    pose = view.camera.world_to_camera.clone()
    pose[place] = bad
    object.__setattr__(view, "camera", dataclasses.replace(view.camera, world_to_camera=pose))
    with pytest.raises(BackendError) as caught:
        next(steps)
    for word in ("step 6", f"view {view.name}", "pose"):
        assert word in str(caught.value)
    assert all(torch.equal(tensor, before[name]) for name, tensor in training.state().items())


def test_too_many_in_a_row_end_the_run_with_a_finite_model() -> None:
    scene = tiny_scene(views=4, size=16)
    training = training_of(scene=dataclasses.replace(scene, train=tuple(BrokenView(**vars(v)) for v in scene.train)))
    before = {name: p.detach().clone() for name, p in training.model.named_parameters()}
    with pytest.raises(DivergedError, match=rf"step {MOST_IN_A_ROW}, view .*in a row; "):
        list(train(training))
    assert training.step == MOST_IN_A_ROW
    assert all(torch.equal(p, before[name]) for name, p in training.model.named_parameters())


def test_bad_steps_take_no_more_memory_than_good_ones() -> None:
    scene = tiny_scene(views=4, size=16)
    training = training_of(scene=dataclasses.replace(scene, train=tuple(BrokenView(**vars(v)) for v in scene.train)))
    rasterizer = training.model.rasterize
    spare: list[int] = []
    with pytest.raises(DivergedError):
        spare.extend(len(rasterizer.spare) for _ in train(training))
    assert max(spare) == 1


def test_what_is_saved_after_too_many_goes_on_from_a_whole_step() -> None:
    """Elements whose gradients were good have moved in the last bad step, so that it must count as done."""
    training = training_of("3dgs", steps=30)
    spoil_gradient(training, "columns.means", float("nan"), row=0, always=True)
    with pytest.raises(DivergedError, match="10th bad step in a row"):
        list(train(training))
    assert training.step == MOST_IN_A_ROW
    assert set(training.state()["optimizer.updates"].tolist()) == {MOST_IN_A_ROW}
    resumed = training_of("3dgs", steps=30)
    resumed.restore(training.state())
    assert next(train(resumed)).fault is None, "what was mended meanwhile gets its chance"


def test_the_count_survives_a_stop() -> None:
    scene = tiny_scene(views=4, size=16)
    scene = dataclasses.replace(scene, train=tuple(BrokenView(**vars(v)) for v in scene.train))
    first, second = training_of(scene=scene), training_of(scene=scene)
    steps = train(first)
    for _ in range(6):
        next(steps)
    second.restore(first.state())
    with pytest.raises(DivergedError, match=f"step {MOST_IN_A_ROW},"):
        list(train(second))


@pytest.mark.parametrize(
    ("method", "name", "bad"), [spoiled for spoiled in OTHERWISE_SPOILED if spoiled[1] != "columns.mask_logits"]
)
def test_a_parameter_ends_the_run_by_its_name_or_is_never_saved(method: str, name: str, bad: float, tmp_path) -> None:
    training = training_of(method, steps=12)
    steps = train(training)
    for _ in range(BEFORE[method]):
        next(steps)
    parameter = dict(training.model.named_parameters())[name]
    parameter.data.view(len(parameter), -1)[0, 0] = bad
    with pytest.raises(DivergedError) as caught:
        next(steps)
    for word in (f"step {BEFORE[method] + 1}", name, "row 0"):
        assert word in str(caught.value)
    header = model_header(method, METHODS[method], training.step, scene_facts(training.batches.scene))
    with pytest.raises(DivergedError, match=f"{name} holds"):
        save_model(tmp_path / "model", training.model, header, [v.camera for v in training.batches.scene.train])
    assert list(tmp_path.iterdir()) == []


def test_a_model_file_that_is_not_finite_is_refused_by_name(tmp_path) -> None:
    training = training_of()
    cameras = [view.camera for view in training.batches.scene.train]
    tensors = training.model.state_dict() | tensors_from_cameras(cameras)
    tensors["columns.log_scales"] = tensors["columns.log_scales"].clone()
    tensors["columns.log_scales"][7, 1] = float("nan")
    write_model_file(tmp_path / "m", tensors, model_header("3dgs", METHODS["3dgs"], 0, scene_facts(tiny_scene())))
    with pytest.raises(ModelFileError, match=r"columns\.log_scales holds nan in row 7; "):
        load_model(tmp_path / "m", rasterizer_for("auto"))


@pytest.mark.parametrize("bad", BAD)
@pytest.mark.parametrize("moment", ["mean", "square"])
def test_a_moment_ends_the_run_by_its_name(moment: str, bad: float) -> None:
    training = training_of("3dgs", steps=12)
    steps = train(training)
    next(steps)
    training.optimizer.moments[f"{moment}.columns.log_scales"][3, 1] = bad
    with pytest.raises(DivergedError) as caught:
        next(steps)
    for word in ("step 2, view ", f"Adam's {moment}.columns.log_scales holds", "row 3"):
        assert word in str(caught.value)
    assert all(p.isfinite().all() for p in training.model.parameters())
