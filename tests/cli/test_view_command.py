"""``ringlight view`` and ``train --view``: what they show, what they refuse, and how they end."""

import re
import shutil
import signal
import socket
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import closing, contextmanager
from pathlib import Path

import numpy as np
import pytest
from browser import Browser
from cli_session import QUICK
from command import Command
from refusal import refused, snapshot
from scenes_on_disk import picture, write_tiny_scene

from ringlight.data.load import load_scene
from ringlight.view.standpoint import standpoint_at

pytest.importorskip("viser", reason="the [view] extra is not installed")


LONG = "5000000"
"""Steps of a training that nothing but a signal ends: 100,000 of them took 22 seconds, less than a busy browser."""


@contextmanager
def taken_port() -> Iterator[int]:
    with socket.socket() as other:
        other.bind(("127.0.0.1", 0))
        other.listen()
        yield other.getsockname()[1]


@pytest.fixture
def without_viser(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "viser", None)


def test_without_the_extra_a_sentence_names_it(
    trained: dict[str, Path], tiny: Path, tmp_path: Path, ringlight: Command, without_viser: None
) -> None:
    refused(ringlight("view", trained["3dgs"]), 1, "pip install 'ringlight[view]'")
    refused(ringlight("train", tiny, "3dgs", "--view", "--out", tmp_path / "run", *QUICK), 1, "ringlight[view]")
    assert not (tmp_path / "run").exists()


def test_what_cannot_be_looked_at_is_one_sentence(
    trained: dict[str, Path], tiny: Path, tmp_path: Path, ringlight: Command
) -> None:
    run = trained["3dgs"]
    refused(ringlight("view"), 2, "nothing is named")
    refused(ringlight("view", tmp_path / "none"), 1, tmp_path / "none")
    refused(ringlight("view", tmp_path), 1, tmp_path)
    refused(ringlight("view", run, tiny), 1, "--scene")
    refused(ringlight("view", tiny, tiny), 1, "--scene")
    refused(ringlight("view", run, "--port", "70000"), 1, "70000")
    damaged = Path(shutil.copytree(run, tmp_path / "damaged"))
    model = damaged / "model.safetensors"
    model.write_bytes(model.read_bytes()[:-100])
    refused(ringlight("view", damaged), 1, model)
    with taken_port() as port:
        before = snapshot(run)
        refused(ringlight("view", run, "--port", port), 1, port, "--port")
        refused(ringlight("train", tiny, "3dgs", "--view", "--port", port, "--out", tmp_path / "new", *QUICK), 1, port)
    assert not (tmp_path / "new").exists()
    assert snapshot(run) == before


def test_runs_of_different_scenes_are_refused(trained: dict[str, Path], tmp_path: Path, ringlight: Command) -> None:
    other = write_tiny_scene(tmp_path / "other", views=5)
    assert ringlight("train", other, "3dgs", "--out", tmp_path / "run", "--steps", "2", *QUICK[-2:]).code == 0
    refused(ringlight("view", trained["3dgs"], tmp_path / "run"), 1, "different scenes", tmp_path / "run")


@contextmanager
def command(*words: object) -> Iterator[tuple[subprocess.Popen, Browser, list[str]]]:
    """A command in a process of its own, a browser where it says to look, and the lines that it said. What it said
    before it hung up on the browser is the failure's message."""
    from websockets.exceptions import ConnectionClosed  # of the [view] extra, without which this file is skipped

    line = [sys.executable, "-m", "ringlight", *map(str, words), "--port", "0", "--threads", "1"]
    said: list[str] = []
    with subprocess.Popen(line, stderr=subprocess.PIPE, stdout=subprocess.DEVNULL, text=True) as process:
        try:
            assert process.stderr is not None
            for text in process.stderr:
                said.append(text.rstrip("\n"))
                if found := re.match(r"look at (http://127\.0\.0\.1:\d+)", text):
                    try:
                        with closing(Browser(found[1])) as browser:
                            yield process, browser, said
                    except ConnectionClosed as error:
                        raise AssertionError("\n".join([*said, process.communicate(timeout=30)[1]])) from error
                    return
            raise AssertionError(said)
        finally:
            process.kill()


def seen(browser: Browser, holds) -> None:
    end = time.monotonic() + 60
    while not holds():
        assert time.monotonic() < end
        browser.listen(0.1)


def test_a_run_is_looked_at_and_ended_by_a_signal(trained: dict[str, Path], tiny: Path) -> None:
    run = trained["3dgs"]
    before = snapshot(run)
    camera = load_scene(tiny).test[0].camera
    with command("view", run) as (process, browser, _):
        browser.stand(standpoint_at(camera, 20, 20))
        wanted = picture(next((run / "images" / "test").glob("*r_0*")))
        seen(browser, lambda: browser.picture is not None and np.abs(browser.picture - wanted.astype(float)).mean() < 6)
        process.send_signal(signal.SIGINT)
        _, err = process.communicate(timeout=30)
        assert process.returncode == 0
        assert err.splitlines()[-1] == "the viewer has ended"
        assert "Traceback" not in err
    assert snapshot(run) == before


def test_a_scene_alone_shows_its_photographs_and_points(tiny: Path) -> None:
    with command("view", tiny) as (_, browser, said):
        view = load_scene(tiny).test[0]
        browser.stand(standpoint_at(view.camera, 20, 20))
        seen(browser, lambda: browser.picture is not None)
        assert browser.last("PointCloudMessage") is not None
        assert len([m for m in browser.messages if m["type"] == "CameraFrustumMessage"]) == 8
        wanted = view.image(load_scene(tiny).background_color).permute(1, 2, 0).numpy() * 255
        assert np.abs(browser.picture - wanted).mean() < 6
        assert not [line for line in said if "warning" in line]


def test_a_model_without_its_scene_is_shown_with_a_sentence(
    tmp_path: Path, ringlight: Command, trained: dict[str, Path]
) -> None:
    ply = tmp_path / "a.ply"
    assert ringlight("export", trained["3dgs"], ply).code == 0
    with command("view", ply) as (process, browser, said):
        browser.listen(0.5)
        assert process.poll() is None
    assert [line for line in said if "holds no cameras" in line and "--scene" in line]


def test_a_training_that_is_looked_at_pauses_saves_and_ends_as_ever(tiny: Path, tmp_path: Path) -> None:
    run = tmp_path / "run"
    words = [word for word in QUICK if word != "--quiet"]
    with command("train", tiny, "3dgs", "--out", run, "--view", *words, "--steps", LONG) as (process, browser, _):
        browser.stand(standpoint_at(load_scene(tiny).test[0].camera, 20, 20))
        seen(browser, lambda: browser.picture is not None)
        browser.press("pause")
        seen(browser, lambda: "'continue'" in str(browser.messages[-60:]))
        browser.press("save")
        seen(browser, lambda: "saved after step" in str(browser.messages[-60:]))
        assert (run / "model.safetensors").exists()
        process.send_signal(signal.SIGINT)
        _, err = process.communicate(timeout=60)
        assert process.returncode == 128 + signal.SIGINT
        assert "and saved; go on with: ringlight train --resume" in err
        assert "Traceback" not in err
