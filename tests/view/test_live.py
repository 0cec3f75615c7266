"""Training has the same bits whether or not somebody looks, and nothing that a viewer does can stop it."""

import re
from collections.abc import Callable
from pathlib import Path

import pytest
from recorded_page import RecordedPage, standing
from scenes_on_disk import write_tiny_scene

from ringlight.data.options import SceneOptions
from ringlight.fit.train import Progress
from ringlight.runs.session import Session
from ringlight.runs.start import start_run
from ringlight.runs.verify import digest_of
from ringlight.view.live import LiveRun, LossCurve
from ringlight.view.wishes import Ask
from small_recipes import small

STEPS = 40
LOOKS = (
    ("light", 0.5),
    ("layer", "normal"),
    ("layer", "depth"),
    ("layer", "color"),
    ("arrangement", "curtain"),
    ("light", 2.0),
    ("arrangement", "side by side"),
    ("light", 0.0),
    ("arrangement", "alone"),
    ("left", "photograph"),
)


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return write_tiny_scene(tmp_path_factory.mktemp("scene") / "balls")


@pytest.fixture
def started(folder: Path, tmp_path: Path) -> Callable[[str, str], Session]:
    def start(method: str, name: str) -> Session:
        recipe = small(method, steps=STEPS)
        return start_run(tmp_path / name, folder, method, recipe, SceneOptions(), 0, "cpu")

    return start


def live(session: Session) -> tuple[LiveRun, RecordedPage]:
    page = RecordedPage()
    return LiveRun(session, lambda subject, wishes: page), page


@pytest.mark.parametrize("method", ["3dgs", "ringlight-basis", "ringlight-ring", "ringlight-mirror"])
def test_looking_changes_no_bit(method: str, started: Callable[[str, str], Session]):
    alone, seen = started(method, "alone"), started(method, "seen")
    for _ in alone.steps():
        pass
    run, page = live(seen)
    cameras = [view.camera for view in seen.scene.train]
    for progress in seen.steps():
        step = progress.step
        run.wishes.stand(0, standing(cameras[step % len(cameras)], 40 + step, 30), float(step))
        run.wishes.wish(*LOOKS[step % len(LOOKS)])
        if step == STEPS // 2:
            run.wishes.ask(Ask.SAVE, 0)
            run.wishes.ask(Ask.GO_TO_VIEW, 0, seen.scene.train[0].name)
        run.viewer._share.note(-1.0, -1.0)  # no pause between pictures
        assert run.see(progress, []) is None
    run.close()
    assert len([picture for _, picture, _ in page.pictures if picture is not None]) > STEPS // 2
    assert page.is_closed
    assert digest_of(seen.training.state()) == digest_of(alone.training.state())
    alone.save()
    seen.save()
    assert seen.folder.model.read_bytes() == alone.folder.model.read_bytes()


@pytest.mark.parametrize("kind", [OSError, KeyError, AssertionError])
def test_a_viewer_that_fails_is_one_sentence_and_training_goes_on(
    started: Callable[[str, str], Session], kind: type[Exception]
):
    session = started("3dgs", "run")
    run, page = live(session)
    run.wishes.stand(0, standing(session.scene.train[0].camera), 0.0)

    def fail(*_: object) -> None:
        raise kind("the network is gone")

    page.show = fail
    said = [sentence for progress in session.steps() if (sentence := run.see(progress, []))]
    assert len(said) == 1
    assert re.fullmatch(r"the viewer has failed \('?the network is gone'?\); training goes on without it", said[0])
    assert session.training.step == STEPS
    assert page.is_closed
    run.close()


def test_a_pause_ends_by_the_button_by_a_signal_or_where_nobody_is_left(
    started: Callable[[str, str], Session], monkeypatch: pytest.MonkeyPatch
):
    session = started("3dgs", "run")
    run, _ = live(session)
    point = standing(session.scene.train[0].camera, 16, 16)
    steps = session.steps()

    def pause() -> Progress:
        run.wishes.ask(Ask.PAUSE, 0)
        return next(steps)

    stopping: list[int] = []
    waits = 0

    def wait(seconds: float) -> None:
        nonlocal waits
        waits += 1
        if waits == 3:
            run.wishes.ask(Ask.CONTINUE, 0)
        if waits == 6:
            stopping.append(2)

    monkeypatch.setattr(run.wishes.changed, "wait", wait)
    run.wishes.stand(0, point, 0.0)
    assert run.see(pause(), stopping) is None
    assert waits == 3
    assert run.see(pause(), stopping) is None
    assert waits == 6
    assert run.viewer.is_paused
    stopping.clear()
    run.wishes.leave(0)
    assert run.see(pause(), stopping) is None
    assert not run.viewer.is_paused
    assert waits > 100
    session.lock.release()


def test_the_curve_of_the_loss_is_of_bounded_length_and_goes_back_with_the_training(
    started: Callable[[str, str], Session],
):
    session, curve = started("3dgs", "run"), LossCurve(10 * 200)
    first = next(session.steps())
    from dataclasses import replace

    for step in range(1, 2001):
        curve.note(replace(first, step=step))
    assert curve.steps == list(range(10, 2001, 10))
    assert curve.values == pytest.approx([first.loss] * 200)
    curve.note(replace(first, step=1001))
    assert curve.steps[-1] == 1000
    curve.note(replace(first, step=1002, fault="not finite"))
    for step in range(1003, 1011):
        curve.note(replace(first, step=step))
    assert curve.steps[-1] == 1010
    session.lock.release()


def test_facts_and_curves_of_a_run(started: Callable[[str, str], Session]):
    session = started("3dgs", "run")
    run, page = live(session)
    run.wishes.stand(0, standing(session.scene.train[0].camera, 16, 16), 0.0)
    for progress in session.steps():
        run.viewer._told = float("-inf")
        run.viewer._share.note(-1.0, -1.0)
        run.see(progress, [])
    assert page.states[-1][0].startswith("step 40 of 40, ")
    (curves,) = page.drawn[-1].values()
    assert curves.psnr_steps == tuple(range(1, 41))
    assert len(curves.loss) == len(curves.loss_steps) == 40
    assert curves.loss[-1] < curves.loss[0]
    session.lock.release()
