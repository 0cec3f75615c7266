"""A real server, and a browser's websocket: what is wished there is shown there, and others get nothing."""

import socket
import time
import urllib.request
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from urllib.error import HTTPError

import numpy as np
import pytest
import torch
from browser import Browser
from recorded_page import standing, subject_of, trained

from ringlight.errors import BackendError, RunError
from ringlight.files.key_frame_flight import flown
from ringlight.files.key_frames import read_key_frames
from ringlight.files.nerfstudio_path import read_nerfstudio_path
from ringlight.view import viser_server
from ringlight.view.curves import Curves
from ringlight.view.key_frames import FRAMES
from ringlight.view.viewer import Viewer, first_wishes
from ringlight.view.viser_page import ViserPage
from tiny_scene import tiny_scene

pytest.importorskip("viser", reason="the [view] extra is not installed")

SCENE = tiny_scene(views=6, size=24)
HOSTILE = "</script><script>alert(1)</script>{1+1}\u202e.png"


class Served:
    """A viewer whose turns are taken while a test listens."""

    def __init__(self, home: Path):
        self.home, self.model = home, trained("3dgs", SCENE).model
        about = subject_of(SCENE, home, **{HOSTILE: trained("3dgs", SCENE)})
        self.wishes = first_wishes(about)
        self.page = ViserPage(about, self.wishes, "127.0.0.1", 0, is_trained=False)
        self.viewer = Viewer(about, self.page, self.wishes)

    def until(self, browser: Browser, holds) -> None:
        """Take turns until something holds."""
        end = time.monotonic() + 30
        while not holds():
            assert time.monotonic() < end, {message["type"] for message in browser.messages}
            self.viewer.turn()
            browser.listen(0.02)

    def drawn(self, point) -> np.ndarray:
        return self.model.render(point.camera(), torch.ones(3)).color.detach().clamp(0, 1).numpy() * 255


@pytest.fixture(scope="module")
def served(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Served]:
    found = Served(tmp_path_factory.mktemp("home"))
    yield found
    found.page.close()


@pytest.fixture
def browser(served: Served) -> Iterator[Browser]:
    found = Browser(served.page.address)
    yield found
    found.close()


POINT = standing(SCENE.test[0].camera, 64, 48)


def looks_like(picture: np.ndarray | None, wanted: np.ndarray) -> bool:
    return picture is not None and picture.shape == wanted.shape and float(np.abs(picture - wanted).mean()) < 4


def test_a_browser_sees_the_model_from_where_it_stands(served: Served, browser: Browser):
    browser.stand(POINT)
    served.until(browser, lambda: looks_like(browser.picture, served.drawn(POINT)))
    other = standing(SCENE.test[1].camera, 40, 60)
    assert not looks_like(browser.picture, served.drawn(other))
    browser.stand(other)
    served.until(browser, lambda: looks_like(browser.picture, served.drawn(other)))


def test_controls_are_wishes(served: Served, browser: Browser):
    browser.stand(POINT)
    served.until(browser, lambda: browser.picture is not None)
    browser.set("layer", "alpha")
    served.until(browser, lambda: browser.picture is not None and float(np.ptp(browser.picture, axis=-1).mean()) < 1)
    browser.set("layer", "color")
    browser.set("light", 0.0)
    served.until(browser, lambda: served.wishes.look.light == 0.0 and served.wishes.look.layer == "color")
    browser.set("light", 1.0)
    browser.set("camera", SCENE.train[1].name)
    browser.press("go there")
    served.until(browser, lambda: not (browser.last("SetCameraPositionMessage") or {"initial": True})["initial"])
    for _ in range(2):
        browser.press("add key frame")
    browser.press("write")
    served.until(browser, lambda: (served.home / "path-1.json").exists())
    flight = read_key_frames(served.home / "path-1.json", None, None)
    assert torch.allclose(flown(flight, np.zeros(1))[0].world_to_camera, POINT.camera().world_to_camera, atol=1e-5)
    browser.set("file of", FRAMES)
    browser.press("write")
    served.until(browser, lambda: (served.home / "path-2.json").exists())
    film = read_nerfstudio_path(served.home / "path-2.json", 1000).cameras
    assert torch.allclose(film[0].world_to_camera, POINT.camera().world_to_camera, atol=1e-5)
    served.until(browser, lambda: browser.last("NotificationShowMessage") is not None)


def test_a_window_higher_than_wide_shows_all_that_the_first_camera_does(served: Served, browser: Browser):
    start = SCENE.test[0].camera
    browser.stand(replace(standing(start, start.width, start.height), width=30, height=90))
    wanted = standing(start, 30, 90).fov
    assert wanted > 1.5 * standing(start, start.width, start.height).fov

    def told() -> list[float]:
        return [message["fov"] for message in browser.messages if message["type"] == "SetCameraFovMessage"]

    served.until(browser, lambda: any(abs(fov - wanted) < 1e-5 for fov in told()))


def test_curves_of_runs_are_drawn_and_those_without_are_not(served: Served, browser: Browser):
    browser.listen(0.5)
    made = [message["props"] for message in browser.messages if message["type"] == "GuiUplotMessage"]
    assert [props["title"] for props in made] == ["training PSNR, dB", "loss", "size, thousands"]
    assert not any(props["visible"] for props in made)
    assert HOSTILE in {series["label"] for series in made[0]["series"]}
    served.page.curves({HOSTILE: Curves((1, 3), (20.0, 21.0), (5, 6))})
    served.until(browser, lambda: len(shown_charts(browser)) == 2)
    browser.listen(0.5)
    assert len(shown_charts(browser)) == 2, "no loss is known"


def shown_charts(browser: Browser) -> list[dict]:
    updates = [m for m in browser.messages if m["type"] == "GuiUpdateMessage" and m["updates"].get("visible")]
    charts = {m["uuid"] for m in browser.messages if m["type"] == "GuiUplotMessage"}
    return [update for update in updates if update["uuid"] in charts]


def test_names_are_shown_as_text_and_never_as_markdown(browser: Browser):
    browser.listen(0.5)
    choices = [message["props"]["options"] for message in browser.messages if message["type"] == "GuiDropdownMessage"]
    assert any(HOSTILE in options for options in choices)
    assert {message["type"] for message in browser.messages}.isdisjoint({"GuiMarkdownMessage", "GuiHtmlMessage"})


def test_a_browser_that_closes_in_the_middle_leaves_the_others(served: Served, browser: Browser):
    browser.stand(POINT)
    leaver = Browser(served.page.address)
    leaver.stand(POINT)
    served.until(browser, lambda: len(served.wishes.browsers) == 2)
    leaver.socket.socket.shutdown(socket.SHUT_RDWR)
    served.until(browser, lambda: len(served.wishes.browsers) == 1)
    served.page.show(12345, np.zeros((4, 4, 3), np.uint8), True)
    served.page.place(12345, POINT, np.zeros(3))
    served.page.tell(12345, "nobody hears this")
    browser.stand(standing(SCENE.test[1].camera, 32, 32))
    served.until(browser, lambda: browser.picture is not None and browser.picture.shape == (32, 32, 3))


def test_pages_of_others_are_refused(served: Served):
    from websockets.exceptions import InvalidStatus

    for origin in ("http://evil.example", "http://127.0.0.1:1", "null"):
        with pytest.raises(InvalidStatus, match="403"):
            Browser(served.page.address, origin=origin)


def test_a_name_that_was_bound_to_this_machine_is_refused(served: Served):
    port = served.page.address.rsplit(":", 1)[1]
    with pytest.raises(HTTPError, match="403"):
        urllib.request.urlopen(urllib.request.Request(served.page.address, headers={"Host": f"evil.example:{port}"}))
    with urllib.request.urlopen(served.page.address) as answer:
        assert b"<html" in answer.read()


def test_a_port_in_use_is_one_sentence(served: Served):
    port = int(served.page.address.rsplit(":", 1)[1])
    for number in (port, 70_000, -1):
        with pytest.raises(RunError, match=f"{number}.*give"):
            viser_server.start_server("127.0.0.1", number)
        with pytest.raises(RunError, match=f"{number}.*give"):
            viser_server.check_address("127.0.0.1", number)
    with pytest.raises(RunError, match="another --host"):
        viser_server.start_server("no such host.example.invalid", 0)


def test_a_viser_that_starts_otherwise_is_not_served_unguarded(monkeypatch: pytest.MonkeyPatch):
    import websockets.asyncio.server as library

    served = library.serve
    in_place = viser_server._Guard.in_place

    class Otherwise(viser_server._Guard):
        def in_place(self):
            return in_place(viser_server._Guard(self.listening, self.host))

    monkeypatch.setattr(viser_server, "_Guard", Otherwise)
    with pytest.raises(BackendError, match="constraints"):
        viser_server.start_server("127.0.0.1", 0)
    assert library.serve is served
