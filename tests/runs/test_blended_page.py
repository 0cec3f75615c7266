"""A shared page with light packs: at the slider's ends the model's own pictures and those under a pack, in the middle
their mean.

Skipped with a sentence where no browser is.
"""

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch
from scenes_on_disk import write_tiny_scene

from browsers import Tab, chromium, playwright, tab
from polished import polish
from ringlight.cli.main import run
from ringlight.color.basis_opacities import OPACITY_BASIS
from ringlight.core.camera import Camera
from ringlight.core.gradients import COLUMNS
from ringlight.core.want import Want
from ringlight.files.packed import unpack_tensors
from ringlight.files.page.blurred_light import TEXELS
from ringlight.methods.light_edit import LightEdit
from ringlight.methods.store import StoredModel, model_of_tensors, tensors_from_cameras
from ringlight.runs.edit import edit_light
from ringlight.runs.light_pack import COLORS, LightPack, pack_between, transformed, write_pack
from ringlight.runs.opened import Opened, open_model
from ringlight.runs.share import share
from ringlight.runs.sized_page import page_for

VIEWS, SIDE = 6, 64

STEPS = ("--steps", "40", "--initial-points", "300", "--densify.begin", "10", "--densify.every", "20")
SMALL = (
    *("--light.ring.head-hidden", "16", "--light.ring.position-nodes", "64", "--light.ring.view-nodes", "8"),
    *("--light.render-hidden", "32", "--light.modulation-hidden", "16"),
)
SETTINGS = {
    "ringlight-basis": (),
    "ringlight-ring": SMALL,
    "ringlight-mirror": (),
    "gaussian-shader": ("--environment-side", "16", "--start.points", "300"),
}

EXACT = 65.0
"""dB, as test_shared_page.py."""

COLORS_OF_OTHER_LIGHT = torch.tensor([[0.8, 0.1, 0.0, 0.02], [0.0, 0.7, 0.0, 0.0], [0.1, 0.0, 0.5, -0.01]])


@pytest.fixture(scope="module")
def runs(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Path]:
    home = tmp_path_factory.mktemp("blended")
    scene = write_tiny_scene(home / "balls", VIEWS, SIDE)
    runs = {method: home / method for method in SETTINGS}
    for method, flags in SETTINGS.items():
        assert run(["train", str(scene), method, "--out", str(runs[method]), *STEPS, *flags, "--quiet", "--lpips"]) == 0
    polish(runs["gaussian-shader"])
    return runs


@pytest.fixture(scope="module")
def browser() -> Iterator[Any]:
    with playwright() as driver, chromium(driver) as found:
        yield found


@pytest.fixture
def page(browser: Any) -> Iterator[Tab]:
    with tab(browser) as found:
        yield found
        assert not found.complaints


def other_light(stored: StoredModel, seed: int, path: Path) -> LightPack:
    """A pack of shared tensors that were moved at random."""
    noise, tensors = torch.Generator().manual_seed(seed), stored.model.rendering_tensors()
    moved = {}
    for name, tensor in tensors.items():
        # Light changes no shape, and no opacity.
        is_light = not name.startswith(COLUMNS) and not name.endswith(("box", OPACITY_BASIS))
        if tensor.dtype == torch.float32 and is_light:
            shape = tensor.shape[-1:] if name == TEXELS else tensor.shape  # blurred noise is hardly seen
            moved[name] = tensor + 0.5 * tensor.std(correction=0) * torch.randn(shape, generator=noise)
    if stored.header.method == "ringlight-basis":
        moved[f"{COLUMNS}sh_dc"] = transformed(tensors[f"{COLUMNS}sh_dc"], COLORS_OF_OTHER_LIGHT / seed)
    pack = pack_between(stored, tensors | moved, f"light {seed}", path)
    write_pack(pack)
    return pack


def picture(opened: Opened, camera: Camera, pack: LightPack | None = None) -> torch.Tensor:
    """What the page holds, exactly drawn."""
    stored, model = opened.stored, opened.stored.model.splats()
    assert model is not None
    page = page_for(opened, model, None, ())
    tensors = unpack_tensors(page.packed)
    if pack is not None:
        light = pack.tensors
        colors = light.pop(COLORS, None)
        if colors is not None:
            tensors[f"{COLUMNS}sh_dc"] = transformed(tensors[f"{COLUMNS}sh_dc"], colors)
        tensors |= light
    tensors |= tensors_from_cameras(stored.cameras)
    model = model_of_tensors(tensors, stored.header, stored.rasterize, Path("page")).model
    with torch.no_grad():
        color: torch.Tensor = model.render(camera, torch.ones(3), Want.EXACT).color
    return color


def psnr(first: np.ndarray, second: torch.Tensor) -> float:
    return float(-10 * np.log10(np.mean((first.clip(0, 1) - second.clamp(0, 1).numpy()) ** 2) + 1e-30))


@pytest.mark.parametrize("method", SETTINGS)
def test_the_slider_goes_from_the_own_light_to_a_packs(
    method: str, runs: dict[str, Path], tmp_path: Path, page: Tab
) -> None:
    opened = open_model(runs[method])
    stored, camera = opened.stored, opened.stored.cameras[0]
    packs = [other_light(stored, seed, tmp_path / f"{seed}.safetensors") for seed in (1, 2)]
    share(opened, tmp_path / "page.html", packs=packs)
    assert page.open(tmp_path / "page.html", "#view=train-0&bare&pack=2&blend=1") == "drawn"
    own, *lit = (picture(opened, camera, pack) for pack in (None, *packs))
    assert psnr(own.numpy(), lit[0]) < EXACT - 15
    assert psnr(lit[0].numpy(), lit[1]) < EXACT - 15
    assert psnr(page.values(), lit[1]) > EXACT
    for pack in (0, 1):
        for blend in (0.0, 0.25, 0.5, 1.0):
            page.look(pack=pack, blend=blend)
            assert psnr(page.values(), own * (1 - blend) + lit[pack] * blend) > EXACT - 5, (pack, blend)


def test_a_person_blends_by_slider_choice_and_key(runs: dict[str, Path], tmp_path: Path, page: Tab) -> None:
    opened = open_model(runs["ringlight-basis"])
    packs = [other_light(opened.stored, seed, tmp_path / f"{seed}.safetensors") for seed in (1, 2)]
    share(opened, tmp_path / "page.html", packs=packs)
    page.open(tmp_path / "page.html")
    look = "(({ pack, blend }) => [pack, blend])(window.ringlight.viewer.look)"
    page.page.keyboard.press("c")  # folded where there is little room
    assert page.page.is_visible("#blend-row")
    assert page.page.eval_on_selector_all("#packs option", "found => found.map((one) => one.text)") == [
        "light 1",
        "light 2",
    ]
    page.page.select_option("#packs", "1")
    page.page.evaluate("document.getElementById('fold').focus()")
    page.page.keyboard.press("l")
    assert page.page.evaluate(look) == [1, 1]
    page.page.fill("#blend", "0.4")
    assert page.page.evaluate(look) == [1, 0.4]
    assert page.page.inner_text("#blend-value") == "0.40"


def test_without_packs_there_is_no_slider(runs: dict[str, Path], tmp_path: Path, page: Tab) -> None:
    share(open_model(runs["ringlight-basis"]), tmp_path / "page.html")
    page.open(tmp_path / "page.html", "#blend=1&pack=3")
    page.page.keyboard.press("c")
    assert page.page.is_visible("#light-row")
    assert not page.page.is_visible("#blend-row")
    assert page.page.evaluate("window.ringlight.viewer.look.blend") == 0


def test_the_page_of_an_edited_ring_shows_the_edit(runs: dict[str, Path], tmp_path: Path, page: Tab) -> None:
    out = tmp_path / "edited.safetensors"
    edit_light(open_model(runs["ringlight-ring"]), out, LightEdit((1.0, 0.8, 0.6), (0.4, 1.0, 2.0)))
    opened = open_model(out)
    share(opened, tmp_path / "page.html")
    page.open(tmp_path / "page.html", "#view=train-0&bare")
    assert psnr(page.values(), picture(opened, opened.stored.cameras[0])) > EXACT
