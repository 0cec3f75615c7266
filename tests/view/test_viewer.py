"""What browsers get: coarse while they move, fine when they rest, and nothing twice."""

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import torch
from recorded_page import Clock, RecordedPage, standing, subject_of, trained

from ringlight.core.scene import Scene
from ringlight.errors import OutputError, SceneError
from ringlight.view.curves import Curves
from ringlight.view.key_frames import FRAMES
from ringlight.view.pacing import REST_SECONDS
from ringlight.view.subject import MOST_CAMERAS, PHOTOGRAPH, subject
from ringlight.view.viewer import Trained, Viewer, first_wishes
from ringlight.view.wishes import Ask
from tiny_scene import tiny_scene


@pytest.fixture(scope="module")
def scene() -> Scene:
    return tiny_scene(views=6, size=24)


@pytest.fixture(scope="module")
def model(scene: Scene):
    return trained("3dgs", scene)


class Looking:
    """A viewer with a clock of the test's own."""

    def __init__(self, about, training: Trained | None = None, each: float = 0.0):
        self.page, self.clock = RecordedPage(), Clock(each)
        self.wishes = first_wishes(about)
        self.viewer = Viewer(about, self.page, self.wishes, training, self.clock)

    def rest(self, most: int = 60) -> int:
        """Turns until nothing is left to do, with time passing; how many there were."""
        for turn in range(most):
            if not self.viewer.turn() and not self.viewer.is_moving:
                return turn
            self.clock.seconds += REST_SECONDS
        raise AssertionError("there is always something to do")

    @property
    def last(self) -> np.ndarray:
        return self.page.pictures[-1][1]


@pytest.fixture
def looking(scene: Scene, model, tmp_path: Path) -> Looking:
    return Looking(subject_of(scene, tmp_path, gaussians=model))


def test_nobody_looks_and_nothing_is_drawn(looking: Looking):
    assert not looking.viewer.turn()
    assert looking.page.pictures == []


def test_coarse_first_then_fine_then_nothing(looking: Looking, scene: Scene, model):
    looking.wishes.stand(7, standing(scene.test[0].camera), looking.clock())
    assert looking.viewer.turn()
    first = looking.last
    assert first.shape[0] < 240
    assert not looking.viewer.turn(), "while it moves one picture of a view is enough"
    looking.rest()
    browser, picture, is_final = next(shown for shown in reversed(looking.page.pictures))
    assert (browser, picture.shape, is_final) == (7, (240, 320, 3), True)
    drawn = len(looking.page.pictures)
    looking.rest()
    assert len(looking.page.pictures) == drawn
    wanted = model.model.render(standing(scene.test[0].camera).camera(), torch.ones(3)).color.detach().clamp(0, 1)
    assert np.abs(picture / 255 - wanted.numpy()).max() < 0.02


def test_a_new_look_is_drawn_anew(looking: Looking, scene: Scene):
    looking.wishes.stand(0, standing(scene.test[0].camera), looking.clock())
    looking.rest()
    colored = looking.last
    looking.wishes.wish("layer", "alpha")
    looking.rest()
    assert (looking.last[..., 0] == looking.last[..., 1]).all()
    assert (looking.last != colored).any()


def test_two_browsers_take_turns_and_one_may_leave(looking: Looking, scene: Scene):
    for browser in (0, 1):
        looking.wishes.stand(browser, standing(scene.test[browser].camera), looking.clock())
    looking.viewer.turn()
    looking.viewer.turn()
    assert {browser for browser, _, _ in looking.page.pictures} == {0, 1}
    looking.wishes.leave(0)
    looking.rest()
    assert looking.page.pictures[-1][0] == 1
    assert looking.page.pictures[-1][2]


def test_a_photograph_is_shown_where_it_was_taken_and_nowhere_else(looking: Looking, scene: Scene):
    view = scene.test[0]
    looking.wishes.stand(0, standing(view.camera, 24, 24), looking.clock())
    looking.wishes.wish("left", PHOTOGRAPH)
    looking.rest()
    wanted = view.image(torch.ones(3)).permute(1, 2, 0).numpy()
    assert np.abs(looking.last / 255 - wanted).max() < 0.01
    looking.wishes.stand(0, standing(scene.train[0].camera, 24, 24), looking.clock())
    looking.rest()
    assert np.abs(looking.last / 255 - wanted).max() > 0.1
    away = tiny_scene(views=7, size=24, seed=9).train[0].camera
    looking.wishes.stand(0, standing(away, 24, 24), looking.clock())
    looking.rest()
    assert looking.last is None
    looking.wishes.wish("left", "gaussians")
    looking.wishes.wish("arrangement", "curtain")
    looking.rest()
    assert (looking.last[:, 13:] == 128).all(), "gray where there is no photograph"
    assert (looking.last[:, :11] != 128).any()


def test_runs_hang_behind_a_curtain_and_side_by_side(scene: Scene, model, tmp_path: Path):
    looking = Looking(subject_of(scene, tmp_path, first=model, second=trained("3dgs", scene, 1)))
    looking.wishes.stand(0, standing(scene.test[0].camera, 48, 24), looking.clock())
    assert looking.wishes.look.arrangement == "all runs"
    found = {}
    for arrangement in ("all runs", "side by side", "curtain", "alone"):
        looking.wishes.wish("arrangement", arrangement)
        looking.rest()
        found[arrangement] = looking.last
    assert (found["all runs"] == found["side by side"]).all()
    assert (found["curtain"][:, :23] == found["alone"][:, :23]).all()
    assert (found["curtain"][:, 24:] != found["alone"][:, 24:]).any()


def test_runs_side_by_side_are_each_seen_whole_from_a_camera(scene: Scene, model, tmp_path: Path):
    looking = Looking(subject_of(scene, tmp_path, first=model, second=trained("3dgs", scene, 1)))
    camera = scene.train[2].camera
    looking.wishes.stand(0, standing(scene.test[0].camera, 48, 36), looking.clock())
    for arrangement, share in (("all runs", 0.5), ("side by side", 0.5), ("curtain", 1.0), ("alone", 1.0)):
        looking.wishes.wish("arrangement", arrangement)
        looking.wishes.ask(Ask.GO_TO_VIEW, 0, scene.train[2].name)
        looking.rest()
        point = looking.page.places[-1][1]
        assert (point.width, point.height) == (48, 36)
        assert 48 * share / point.camera().focal[0] >= camera.width / camera.focal[0] * (1 - 1e-6), arrangement
    assert looking.page.places[0][1].fov > looking.page.places[-1][1].fov


def test_going_to_a_camera_and_small_photographs(looking: Looking, scene: Scene):
    looking.wishes.stand(3, standing(scene.test[0].camera), looking.clock())
    name = scene.train[2].name
    for value in (name, "no such view", None, ["x"]):
        looking.wishes.ask(Ask.GO_TO_VIEW, 3, value)
    looking.rest()
    (browser, point), *others = looking.page.places
    assert not others
    assert browser == 3
    assert torch.allclose(point.camera().world_to_camera, scene.train[2].camera.world_to_camera, atol=1e-5)
    assert set(looking.page.thumbnails) == {view.name for view in (*scene.train, *scene.test)}


def test_a_camera_that_somebody_stands_in_is_not_drawn(looking: Looking, scene: Scene):
    looking.wishes.stand(0, standing(scene.train[0].camera), looking.clock())
    looking.wishes.stand(1, standing(scene.test[1].camera), looking.clock())
    looking.viewer.turn()
    assert looking.page.hidden == {scene.train[0].name, scene.test[1].name}
    looking.wishes.leave(1)
    looking.wishes.stand(0, standing(tiny_scene(views=7, size=24, seed=9).train[0].camera), looking.clock())
    looking.viewer.turn()
    assert looking.page.hidden == frozenset()


def test_key_frames_are_previewed_and_written(looking: Looking, scene: Scene, tmp_path: Path):
    looking.wishes.ask(Ask.WRITE_PATH, 0, 2.0)
    looking.wishes.ask(Ask.PLAY, 0, 2.0)
    looking.wishes.stand(0, standing(scene.train[0].camera), looking.clock())
    looking.rest()
    assert [trouble for _, sentence, trouble in looking.page.sentences if "no key frame" in sentence] == [False, False]
    for view in scene.train[:2]:
        looking.wishes.stand(0, standing(view.camera), looking.clock())
        looking.wishes.ask(Ask.ADD_KEY, 0)
        looking.viewer.turn()
    looking.wishes.ask(Ask.ADD_KEY, 99)  # a browser that has closed
    looking.viewer.turn()
    assert len(looking.page.key_cameras) == 2
    looking.wishes.ask(Ask.PLAY, 0, 2.0)
    for _ in range(25):
        looking.viewer.turn()
        looking.clock.seconds += 0.1
    assert len(looking.page.places) > 15
    assert np.allclose(looking.page.places[-1][1].position, scene.train[1].camera.position.tolist(), atol=1e-4)
    looking.wishes.ask(Ask.WRITE_PATH, 0, "nonsense")
    looking.viewer.turn()
    assert f"--path {tmp_path / 'path-1.json'}" in looking.page.sentences[-1][1]
    assert len(json.loads((tmp_path / "path-1.json").read_text())["stops"]) == 2
    for value in ((2.0, FRAMES), (2.0, "no such file"), (None,), ("x", 3)):
        looking.wishes.ask(Ask.WRITE_PATH, 0, value)
    looking.viewer.turn()
    assert len(json.loads((tmp_path / "path-2.json").read_text())["camera_path"]) == 61
    for number in (3, 4, 5):
        assert "stops" in json.loads((tmp_path / f"path-{number}.json").read_text())
    assert not any(trouble for _, _, trouble in looking.page.sentences)


def test_a_damaged_photograph_is_one_sentence(scene: Scene, tmp_path: Path):
    def fail():
        raise SceneError("r_0.png: is damaged; copy it again")

    broken = replace(scene, test=(replace(scene.test[0], load=fail), *scene.test[1:]))
    looking = Looking(subject("t", {}, [], broken, tmp_path))
    looking.wishes.stand(0, standing(scene.test[0].camera), looking.clock())
    looking.rest()
    told = (0, "r_0.png: is damaged; copy it again", True)
    assert looking.page.sentences == [told]
    assert looking.last is None
    looking.wishes.stand(0, standing(scene.test[1].camera), looking.clock())
    looking.rest()
    looking.wishes.stand(0, standing(scene.test[0].camera), looking.clock())
    looking.rest()
    assert looking.page.sentences == [told, told], "who comes back is told again"


def test_a_training_does_not_tell_of_a_damaged_photograph_at_each_step(scene: Scene, model, tmp_path: Path):
    def fail():
        raise SceneError("r_0.png: is damaged; copy it again")

    broken = replace(scene, test=(replace(scene.test[0], load=fail), *scene.test[1:]))
    steps = Steps()
    looking = Looking(subject_of(broken, tmp_path, gaussians=model), steps.trained())
    looking.wishes.stand(0, standing(scene.test[0].camera), looking.clock())
    looking.wishes.wish("left", PHOTOGRAPH)
    for _ in range(20):
        steps.step += 1
        looking.viewer.turn()
        looking.clock.seconds += REST_SECONDS
    assert [sentence for _, sentence, trouble in looking.page.sentences if trouble] == [
        "r_0.png: is damaged; copy it again"
    ]


def test_photographs_hang_in_the_cameras_that_are_drawn(scene: Scene, tmp_path: Path):
    many = replace(scene, train=tuple(replace(scene.train[0], name=f"r_{index}") for index in range(700)), test=())
    about = subject("t", {}, [], many, tmp_path)
    looking = Looking(about)
    looking.wishes.stand(0, standing(scene.train[0].camera), looking.clock())
    looking.rest(400)
    assert len(looking.page.thumbnails) <= MOST_CAMERAS
    assert set(looking.page.thumbnails) == set(about.drawn_views)
    assert {"r_0", "r_699"} <= set(about.drawn_views)


class Steps:
    """A training that a test counts on."""

    def __init__(self):
        self.step, self.saved = 0, 0

    def save(self) -> str:
        self.saved += 1
        if self.saved > 1:
            raise OutputError("model: cannot be written: no space is left")
        return "saved"

    def trained(self) -> Trained:
        return Trained(
            lambda: self.step, lambda: f"step {self.step}", lambda: {"a": Curves((1,), (2.0,), (3,))}, self.save
        )


def test_a_resting_viewer_takes_a_bounded_share_of_a_training(scene: Scene, model, tmp_path: Path):
    steps = Steps()
    looking = Looking(subject_of(scene, tmp_path, gaussians=model), steps.trained(), each=0.004)
    looking.wishes.stand(0, standing(scene.test[0].camera, 32, 24), 0.0)
    spent = begun = 0.0
    for turn in range(800):
        if turn == 200:  # it has been refined
            spent, begun = 0.0, looking.clock.seconds
        steps.step += 1
        before = looking.clock.seconds
        drew = looking.viewer.turn()
        spent += (looking.clock.seconds - before) if drew else 0.0
        looking.clock.seconds += 0.01
    assert 0 < spent / (looking.clock.seconds - begun) < 0.06
    assert looking.page.drawn[-1]["a"].psnr == (2.0,)
    assert looking.page.states[-1][0].startswith("step ")


def test_pause_save_and_continue(scene: Scene, model, tmp_path: Path):
    steps = Steps()
    looking = Looking(subject_of(scene, tmp_path, gaussians=model), steps.trained())
    looking.wishes.stand(0, standing(scene.test[0].camera, 32, 24), 0.0)
    looking.wishes.ask(Ask.PAUSE, 0)
    looking.viewer.turn()
    assert looking.viewer.is_paused
    assert looking.page.states[-1] == ("step 0", True)
    for _ in range(2):
        looking.wishes.ask(Ask.SAVE, 0)
    looking.viewer.turn()
    assert [(sentence, trouble) for _, sentence, trouble in looking.page.sentences] == [
        ("saved", False),
        ("model: cannot be written: no space is left", True),
    ]
    looking.wishes.ask(Ask.CONTINUE, 0)
    looking.viewer.turn()
    assert not looking.viewer.is_paused


def test_what_is_not_trained_can_neither_be_paused_nor_saved(looking: Looking):
    for what in (Ask.PAUSE, Ask.SAVE):
        looking.wishes.ask(what, 0)
    looking.viewer.turn()
    assert not looking.viewer.is_paused
    assert looking.page.sentences == []
