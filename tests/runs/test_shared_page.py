"""A shared page in a browser: the pictures of every method are the exact ones, and what a person does shows.

Skipped with a sentence where no browser is.
"""

import json
import math
import re
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch
from scenes_on_disk import write_tiny_scene

from browsers import Tab, chromium, playwright, tab
from polished import polish
from ringlight.bench.page import SCRIPTS
from ringlight.cli.main import run
from ringlight.color.harmonics import sh_colors_reference
from ringlight.color.illuminated import Illuminated
from ringlight.color.ringlight import RingLight
from ringlight.core.camera import Camera
from ringlight.core.rendering import Emission
from ringlight.core.want import Want
from ringlight.files.layer_pictures import layer_pictures, looking
from ringlight.files.page.document import _modules
from ringlight.files.page.modules import joined
from ringlight.methods.store import StoredModel, save_model
from ringlight.models.splats import SplatModel
from ringlight.runs.opened import open_model
from ringlight.runs.share import share
from ringlight.runs.sized_page import model_held, page_for

VIEWS, SIDE = 6, 72

STEPS = ("--steps", "60", "--initial-points", "400", "--densify.begin", "10", "--densify.every", "20")
SMALL = (
    *("--light.ring.head-hidden", "16", "--light.ring.position-nodes", "64", "--light.ring.view-nodes", "8"),
    *("--light.render-hidden", "32", "--light.modulation-hidden", "16"),
)
SETTINGS = {
    "3dgs": (),
    "ringlight-basis": (),
    "ringlight-ring": SMALL,
    "ringlight-paper": (*SMALL, "--light.ring.features", "16"),
    "ringlight-mirror": (),
    "3dgs-dr": ("--environment-side", "16", "--reflection-rate", "0.5"),
    "light-gaussian": ("--grow-share", "0.5"),
    "glossy-gaussian": ("--opacity-rest-rate", "0.02"),
    "3igs": ("--light.side", "20", "--light.components", "8", "--light.features", "12", "--light.hidden", "32"),
    "gaussian-shader": ("--environment-side", "32", "--start.points", "400", "--ambient"),
}

EXACT, LAYERED = 65.0, 60.0
"""dB of the page's pictures against the exact ones of what it holds, and of its other layers. Measured: 75 and more;
mirrors and rings 70 and more, since our kernels multiply in halves."""

PACKED = 55.0
"""dB against the model before it was packed, mean over five cameras; of so few Gaussians each shows."""


@pytest.fixture(scope="module")
def runs(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Path]:
    home = tmp_path_factory.mktemp("shared")
    scene = write_tiny_scene(home / "balls", VIEWS, SIDE)
    runs = {method: home / method for method in SETTINGS}
    for method, flags in SETTINGS.items():
        assert run(["train", str(scene), method, "--out", str(runs[method]), *STEPS, *flags, "--quiet", "--lpips"]) == 0
    polish(runs["gaussian-shader"])
    return runs


@pytest.fixture(scope="module")
def pages(runs: dict[str, Path], tmp_path_factory: pytest.TempPathFactory) -> dict[str, Path]:
    home = tmp_path_factory.mktemp("pages")
    for method, folder in runs.items():
        share(open_model(folder), home / f"{method}.html")
    return {method: home / f"{method}.html" for method in runs}


@pytest.fixture(scope="module")
def driver() -> Iterator[Any]:
    with playwright() as found:
        yield found


@pytest.fixture(scope="module")
def browser(driver: Any) -> Iterator[Any]:
    with chromium(driver) as found:
        yield found


@pytest.fixture
def page(browser: Any) -> Iterator[Tab]:
    with tab(browser) as found:
        yield found
        assert not found.complaints
        assert not [url for url in found.asked if not url.startswith(("file:", "blob:", "data:"))]


def as_page_holds(folder: Path) -> tuple[StoredModel, SplatModel]:
    """The run's model, and what is left of it once it was packed."""
    opened = open_model(folder)
    model = opened.stored.model.splats()
    assert model is not None
    packed = model_held(opened, page_for(opened, model, None, ()).packed).model.splats()
    assert packed is not None
    return opened.stored, packed


def psnr(first: np.ndarray, second: torch.Tensor) -> float:
    return float(-10 * np.log10(np.mean((first.clip(0, 1) - second.clamp(0, 1).numpy()) ** 2) + 1e-30))


@pytest.mark.parametrize("method", SETTINGS)
def test_pictures_are_the_exact_ones(method: str, runs: dict[str, Path], pages: dict[str, Path], page: Tab) -> None:
    stored, packed = as_page_holds(runs[method])
    assert page.open(pages[method], "#view=train-0&bare") == "drawn"
    losses = []
    for number, camera in enumerate(stored.cameras[:5]):
        seen = page.view(f"train-{number}")
        assert seen.shape == (SIDE, SIDE, 3)
        with torch.no_grad():
            exact, own = (m.render(camera, torch.ones(3), Want.EXACT).color for m in (packed, stored.model))
        assert psnr(seen, exact) > EXACT, number
        # Neither turned round nor mirrored: the picture is nowhere near these.
        assert psnr(seen, exact.flip(0)) < 40
        assert psnr(seen, exact.flip(1)) < 40
        losses.append(psnr(seen, own))
    assert np.mean(losses) > PACKED


@pytest.mark.parametrize("method", SETTINGS)
def test_layers_are_those_of_render(method: str, runs: dict[str, Path], pages: dict[str, Path], page: Tab) -> None:
    stored, packed = as_page_holds(runs[method])
    page.open(pages[method], "#view=train-2&bare")
    near, far = page.page.evaluate("window.ringlight.facts.nearFar")
    wanted = {"base": "base", "normals": "normal", "depth": "depth"}
    look = looking(packed, torch.ones(3), list(wanted.values()))
    found = layer_pictures(look(stored.cameras[2]), torch.ones(3), list(wanted.values()), (near, far))
    for layer, name in wanted.items():
        page.look(layer=layer)
        seen = page.values()
        if name == "normal":  # where nothing is blended a normal has no direction
            alpha = packed.layers(stored.cameras[2])["alpha"][..., 0].numpy() > 0.01
            assert psnr(seen[alpha], found[name][torch.from_numpy(alpha)]) > LAYERED
        else:
            assert psnr(seen, found[name]) > LAYERED, layer


@pytest.mark.parametrize("method", SETTINGS)
@pytest.mark.parametrize("amount", [0.0, 2.0])
def test_the_fader_changes_pixels_as_python_says(
    method: str, amount: float, runs: dict[str, Path], pages: dict[str, Path], page: Tab
) -> None:
    stored, packed = as_page_holds(runs[method])
    camera = stored.cameras[1]
    page.open(pages[method], "#view=train-1&bare")
    page.look(residual=amount)
    with torch.no_grad():
        assert psnr(page.values(), faded(packed, camera, amount)) > EXACT - 5
    page.look(residual=1)
    assert psnr(page.values(), packed.render(camera, torch.ones(3), Want.EXACT).color.detach()) > EXACT


def faded(model: SplatModel, camera: Camera, amount: float) -> torch.Tensor:
    """The picture with so much of what depends on the direction, by the colour model's own parts."""
    if model.shader.adds_light:
        layers = model.layers(camera)
        base = layers["base"] + (1 - layers["alpha"])
        return base + amount * (model.render(camera, torch.ones(3), Want.EXACT).color - base)
    gaussians = model.gaussians
    harmonics = model.harmonics(gaussians)
    if harmonics is not None:
        degree = math.isqrt(harmonics.sh_rest.shape[1])
        colors = sh_colors_reference(
            gaussians.means, harmonics.sh_dc, amount * harmonics.sh_rest, camera.position, degree
        )
    else:
        parts = model.color.layers(gaussians, camera)
        colors = parts["base"] + amount * parts["residual"]
        rings = isinstance(model.color, RingLight) and model.color.settings.clamp_colors
        if amount and (rings or isinstance(model.color, Illuminated)):
            colors = colors.clamp(0, 1)
    factor = model.color.emit(gaussians, camera, ("rgb",), Want.EXACT).opacity_factor
    emission = Emission({"rgb": 3}, colors.contiguous(), factor)
    return model.rasterize.draw(gaussians, emission, camera, torch.ones(3), model.options).image


def test_it_moves_by_mouse_keys_and_stops(pages: dict[str, Path], page: Tab) -> None:
    page.open(pages["ringlight-basis"])
    pictures = [page.values()]
    mouse, keyboard = page.page.mouse, page.page.keyboard

    def changed() -> bool:
        for _ in range(20):  # events reach a page in their own time
            seen = page.values()
            if np.abs(seen - pictures[-1]).max() > 0.02:
                pictures.append(seen)
                return True
            page.page.wait_for_timeout(50)
        return False

    mouse.move(160, 160)
    mouse.down()
    mouse.move(200, 170, steps=4)
    mouse.up()
    assert changed()
    mouse.wheel(0, -200)
    assert changed()
    keyboard.down("d")
    page.page.wait_for_timeout(200)
    keyboard.up("d")
    assert changed()
    keyboard.press("n")
    assert page.page.evaluate("document.getElementById('stops').value") == "train-0"
    assert changed()
    keyboard.press("f")
    mouse.down()
    mouse.move(180, 140, steps=3)
    mouse.up()
    assert changed()
    keyboard.press("3")
    assert changed()
    keyboard.press("1")
    keyboard.press("h")
    page.values()
    assert np.abs(page.values() - pictures[0]).max() < 1e-3


def test_two_fingers_move_and_pinch(browser: Any, pages: dict[str, Path]) -> None:
    with tab(browser, has_touch=True, is_mobile=True) as page:
        page.open(pages["3dgs"])
        before = page.values()
        session = page.page.context.new_cdp_session(page.page)

        def touch(kind: str, *points: tuple[int, int]) -> None:
            found = [{"x": x, "y": y, "id": number} for number, (x, y) in enumerate(points)]
            session.send("Input.dispatchTouchEvent", {"type": kind, "touchPoints": found})

        touch("touchStart", (140, 160), (180, 160))
        touch("touchMove", (120, 160), (200, 160))
        touch("touchMove", (100, 160), (220, 160))
        touch("touchEnd")
        assert np.abs(page.values() - before).max() > 0.1
        assert not page.complaints


WIDTHS = """() => {
  const { viewer } = window.ringlight;
  window.widths = [];
  viewer.onpicture = () => window.widths.push(viewer.picture.canvas.width);
}"""


def test_a_moving_picture_ends_whole(pages: dict[str, Path], page: Tab) -> None:
    page.open(pages["ringlight-ring"])
    page.page.evaluate(WIDTHS)
    page.page.evaluate("window.ringlight.viewer.scale = 0.25")
    page.page.evaluate("window.ringlight.move((pose) => pose.moved(0.1, 0, 0))")
    page.wait_until("window.widths.at(-1) === 400 && window.widths.length > 1")
    assert page.page.evaluate("window.widths[0]") == 100


COLORED = """() => {
  const { kind, seen } = window.ringlight.viewer.picture, { made } = kind.colored;
  const rows = Array.from(seen.rows.subarray(0, seen.count));
  return { now: made.filter((when) => when === 2).length, seen: seen.count, all: rows.every((row) => made[row] === 2) };
}"""


@pytest.mark.parametrize("method", ["3dgs", "ringlight-ring", "3igs"])
def test_only_what_is_seen_is_coloured_and_only_once(method: str, pages: dict[str, Path], page: Tab) -> None:
    """Going near makes the colours of what is in view; turning there, only those that come into it."""
    page.open(pages[method])
    gaussians = page.page.evaluate("window.ringlight.facts.gaussians")
    page.page.evaluate("window.ringlight.move((pose) => pose.nearer(0.3))")
    page.values()
    near = page.page.evaluate(COLORED)
    assert near["now"] == near["seen"] < gaussians
    page.page.evaluate("window.ringlight.move((pose) => pose.turned(0.4, 0, window.ringlight.facts.up, false))")
    seen = page.values()
    turned = page.page.evaluate(COLORED)
    assert turned["all"]
    assert max(near["now"], turned["seen"]) < turned["now"]
    page.page.evaluate("window.ringlight.viewer.picture.kind.colored.forget()")
    assert np.array_equal(page.values(), seen), "colours made at once are those made one after the other"
    assert page.page.evaluate(COLORED)["now"] == turned["seen"]


TIMED = """(async () => {
  const { colored } = window.ringlight.viewer.picture.kind, forget = colored.forget.bind(colored);
  let times = 0;
  colored.forget = () => (times++, forget());
  await picture(0);
  return times;
})()"""


def test_a_timed_picture_is_also_timed_with_new_colours(pages: dict[str, Path], page: Tab) -> None:
    page.open(pages["ringlight-basis"])
    assert page.page.evaluate(f"(0, eval)({json.dumps(SCRIPTS.read_text('utf-8') + TIMED)})") == 1


def test_the_address_holds_the_camera(pages: dict[str, Path], page: Tab) -> None:
    page.open(pages["3dgs"])
    page.page.evaluate("window.ringlight.move((pose) => pose.turned(0.5, 0.1, window.ringlight.facts.up, true))")
    page.wait_until("location.hash.startsWith('#at=')")
    seen, address = page.values(), page.page.evaluate("location.hash")
    page.page.goto("about:blank")
    page.open(pages["3dgs"], address)
    assert psnr(seen, torch.from_numpy(page.values())) > 50


def test_the_address_follows_stops_layers_and_the_fader(pages: dict[str, Path], page: Tab) -> None:
    page.open(pages["3dgs"])
    page.page.keyboard.press("n")
    page.page.keyboard.press("3")
    page.page.keyboard.press("-")
    page.wait_until("location.hash.includes('lens=train-0')")
    page.wait_until("location.hash.includes('layer=normals&light=0.9')")
    seen, address = page.values(), page.page.evaluate("location.hash")
    page.page.goto("about:blank")
    page.open(pages["3dgs"], address)
    assert psnr(seen, torch.from_numpy(page.values())) > 50
    page.page.keyboard.press("h")
    page.wait_until("!location.hash.includes('lens')")


def test_another_address_is_followed_whole(pages: dict[str, Path], page: Tab) -> None:
    page.open(pages["3dgs"], "#view=train-1&layer=normals&light=0.5")
    page.page.evaluate("location.hash = '#view=train-0&bare'")
    page.wait_until("document.documentElement.classList.contains('bare')")
    page.page.evaluate("window.ringlight.settled()")
    found = page.values()
    page.page.goto("about:blank")
    page.open(pages["3dgs"], "#view=train-0")
    assert np.array_equal(page.values(), found)


def test_a_bare_page_has_no_controls(pages: dict[str, Path], page: Tab) -> None:
    page.open(pages["3dgs"], "#view=train-0&bare")
    assert not page.page.is_visible("#panel")
    assert not page.page.is_visible("#caption")
    box = page.page.locator("#picture").bounding_box()
    assert box == {"x": 0, "y": 0, "width": SIDE, "height": SIDE}


def test_the_keys_fit_a_phone(browser: Any, pages: dict[str, Path]) -> None:
    with tab(browser, viewport={"width": 390, "height": 844}) as page:
        page.open(pages["3dgs"])
        page.page.click("#help")
        whole, shown = page.page.evaluate("[keys.scrollHeight, keys.clientHeight]")
        assert whole <= shown < 700
        assert not page.complaints


def test_hostile_names_are_shown_as_text(runs: dict[str, Path], tmp_path: Path, page: Tab) -> None:
    hostile = "</script><img src=x onerror=alert(1)> \"'&amp; \u202egnp"
    shown = hostile.replace("\u202e", r"\u202e")
    stored = open_model(runs["3dgs"]).stored
    header = replace(stored.header, scene=replace(stored.header.scene, name=hostile), preset=hostile)
    save_model(tmp_path / "model.safetensors", stored.model, header, stored.cameras)
    share(open_model(tmp_path / "model.safetensors"), tmp_path / "page.html")
    page.page.on("dialog", lambda _: pytest.fail("the name of a scene was run"))
    page.open(tmp_path / "page.html")
    for part in ("scene", "method"):
        assert page.page.evaluate(f"document.getElementById('caption-{part}').textContent") == shown
    assert page.page.evaluate("document.images.length") == 1
    assert page.page.evaluate("document.title") == f"{shown}, {shown}"


def test_without_webgl_there_is_a_sentence_and_a_still_picture(driver: Any, pages: dict[str, Path]) -> None:
    with chromium(driver, "--disable-3d-apis") as browser, tab(browser) as page:
        assert "WebGL2" in page.open(pages["ringlight-ring"])
        assert page.page.is_visible("#fallback img")
        assert re.search("cannot draw the model.*WebGL2", page.page.inner_text("#sentence"))
        assert page.page.evaluate("document.images[0].naturalWidth") > 100
        assert page.page.is_visible("#caption-scene")


def test_what_fails_while_drawing_is_said(pages: dict[str, Path], page: Tab) -> None:
    page.open(pages["3dgs"])
    page.page.evaluate("window.ringlight.viewer.picture.canvas.dispatchEvent(new Event('webglcontextlost'))")
    assert page.page.is_visible("#fallback img")
    assert "gave up" in page.page.inner_text("#sentence")


LOSE = """() => {
  const lost = window.ringlight.viewer.picture.gl.getExtension("WEBGL_lose_context");
  lost.loseContext();
  window.giveBack = () => lost.restoreContext();
}"""


def test_a_graphics_card_that_comes_back_draws_again(pages: dict[str, Path], page: Tab) -> None:
    page.open(pages["ringlight-mirror"], "#view=train-1")
    before = page.values()
    page.page.evaluate(LOSE)
    page.wait_until("document.documentElement.classList.contains('still')")
    assert (
        page.page.evaluate("window.ringlight.settled().catch((error) => error.message)") == "the graphics card gave up"
    )
    page.page.evaluate("window.giveBack()")
    page.wait_until("!document.documentElement.classList.contains('still')")
    assert np.array_equal(page.values(), before)
    page.complaints.clear()  # Chromium notes the loss


LOST_AT_ONCE = """
const usual = HTMLCanvasElement.prototype.getContext;
HTMLCanvasElement.prototype.getContext = function (...asked) {
  const found = usual.apply(this, asked);
  if (asked[0] === "webgl2" && !window.giveBack) {
    const lost = found.getExtension("WEBGL_lose_context");
    window.giveBack = () => lost.restoreContext();
    this.addEventListener("webglcontextlost", () => (window.isLost = true));
    setTimeout(() => lost.loseContext());
  }
  return found;
};
"""


def test_a_graphics_card_that_is_lost_before_the_first_picture_comes_back(pages: dict[str, Path], page: Tab) -> None:
    page.page.add_init_script(LOST_AT_ONCE)
    page.open(pages["3dgs"])
    page.wait_until("window.isLost")
    page.wait_until("document.documentElement.classList.contains('still')")
    assert not page.page.evaluate("document.documentElement.classList.contains('drawn')"), "nothing was drawn yet"
    page.page.evaluate("window.giveBack()")
    page.wait_until("document.documentElement.classList.contains('drawn')")
    page.page.evaluate("window.ringlight.settled()")
    assert not page.page.is_visible("#fallback")
    assert page.page.evaluate("getComputedStyle(document.getElementById('picture')).opacity") == "1"
    page.complaints.clear()  # Chromium notes the loss


def test_a_browser_that_cannot_inflate_is_told_so(pages: dict[str, Path], page: Tab) -> None:
    page.page.add_init_script("delete window.DecompressionStream")
    page.open(pages["3dgs"])
    assert "cannot inflate" in page.page.inner_text("#sentence")
    assert "of 2023 or later" in page.page.inner_text("#sentence")


def test_who_waits_gets_a_whole_picture_though_it_moves_on(pages: dict[str, Path], page: Tab) -> None:
    page.open(pages["3dgs"])
    page.page.evaluate("window.ringlight.viewer.scale = 0.25")
    width = """async () => {
      const settled = window.ringlight.settled();
      window.ringlight.move((pose) => pose.moved(0.01, 0, 0));
      await settled;
      return window.ringlight.viewer.picture.canvas.width;
    }"""
    assert page.page.evaluate(width) == 400


def test_keys_move_after_a_button_was_pressed_and_never_stick(pages: dict[str, Path], page: Tab) -> None:
    page.open(pages["3dgs"])
    page.page.click("#after")
    before = page.values()
    keyboard = page.page.keyboard
    keyboard.down("d")
    keyboard.down("Control")
    keyboard.up("d")
    keyboard.up("Control")
    rested = page.values()
    assert np.abs(rested - before).max() > 0.01
    page.page.wait_for_timeout(200)
    assert np.array_equal(page.values(), rested)
    page.page.click("#fold")
    page.page.focus("#light")
    keyboard.press("ArrowRight")  # the fader's own
    page.wait_until("document.getElementById('light').value === '1.01'")


POLE = """() => {
  const { move, facts } = window.ringlight, found = [];
  for (const upwards of [3, -6]) {
    move((pose) => {
      const turned = pose.turned(0, upwards, facts.up, true);
      found.push(turned.turn[1].reduce((sum, value, k) => sum + value * facts.up[k], 0));
      return turned;
    });
  }
  return found;
}"""


def test_a_turn_ends_at_the_poles(pages: dict[str, Path], page: Tab) -> None:
    page.open(pages["3dgs"])
    assert all(-0.1 < down < 0 for down in page.page.evaluate(POLE))


def test_an_address_of_anybody_is_a_camera(pages: dict[str, Path], page: Tab) -> None:
    page.open(pages["3dgs"], "#at=0,0,3,9,1,0,0,-5,0,0,0,-2,0")
    turn = np.array(
        page.page.evaluate(
            "(() => { let found; window.ringlight.move((pose) => (found = pose)); return found.turn; })()"
        )
    )
    np.testing.assert_allclose(turn @ turn.T, np.eye(3), atol=1e-6)


def test_names_that_are_no_text_are_shown(runs: dict[str, Path], tmp_path: Path, page: Tab) -> None:
    stored = open_model(runs["3dgs"]).stored
    header = replace(stored.header, scene=replace(stored.header.scene, name="caf\udce9"))
    save_model(tmp_path / "model.safetensors", stored.model, header, stored.cameras)
    share(open_model(tmp_path / "model.safetensors"), tmp_path / "page.html")
    assert page.open(tmp_path / "page.html") == "drawn"
    assert page.page.inner_text("#caption-scene").startswith("caf")


CROWDED = """(() => {
  const lists = new $tile_lists.TileLists(), ellipses = new Float32Array(8 * 40);
  for (let k = 0; k < 40; k++) ellipses.set([300, 300, 0.9, k + 1, 1e-6, 0, 1e-6, k], 8 * k);
  const tiles = new Uint32Array(2 * 65536);
  const { across, down, total, entries } = lists.fill(ellipses, 40, [600, 600], 100, tiles, new Uint32Array(8));
  return [across * down, total, Array.from(tiles.subarray(0, 2 * across * down)), Array.from(entries)];
})()"""


def test_of_too_many_gaussians_those_behind_are_left_out_in_all_tiles(page: Tab) -> None:
    page.page.goto("about:blank")
    code = json.dumps(f"{joined(_modules(), 'tile_lists.js')}\n{CROWDED}")
    count, total, tiles, entries = page.page.evaluate(f"(0, eval)({code})")
    assert (count, total) == (9, 99)
    for first, held in zip(tiles[::2], tiles[1::2], strict=True):
        assert entries[first : first + held] == list(range(11)), "nearest first, equally many in each"


def test_a_damaged_page_says_so(pages: dict[str, Path], tmp_path: Path, page: Tab) -> None:
    text = pages["3dgs"].read_text("utf-8")
    middle = len(text) // 2
    (tmp_path / "cut.html").write_text(text[:middle] + text[middle + 1000 :], "utf-8")
    assert page.open(tmp_path / "cut.html") != "drawn"
    assert page.page.is_visible("#fallback img")
    page.complaints.clear()
