"""Pages of 3igs: condensed as finely as asked, thinned like any other, and in the model's own light alone."""

from pathlib import Path
from statistics import fmean

import pytest
from scenes_on_disk import write_tiny_scene

from ringlight.cli.main import run
from ringlight.color.condensed_illumination import CODED
from ringlight.color.illuminated import Illuminated
from ringlight.errors import RecipeError
from ringlight.files.packed import Packed, unpack_tensors
from ringlight.models.splats import SplatModel
from ringlight.runs.condensed_page import CondensedPage
from ringlight.runs.light_pack import LightPack
from ringlight.runs.opened import Opened, open_model
from ringlight.runs.share import share
from ringlight.runs.sized_page import model_held, page_for

STEPS = ("--steps", "40", "--initial-points", "300", "--densify.begin", "10", "--densify.every", "20")
SMALL = ("--light.side", "12", "--light.components", "4", "--light.features", "8", "--light.hidden", "16")


@pytest.fixture(scope="module")
def scene(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return write_tiny_scene(tmp_path_factory.mktemp("scene") / "balls")


@pytest.fixture(scope="module")
def opened(scene: Path, tmp_path_factory: pytest.TempPathFactory) -> Opened:
    out = tmp_path_factory.mktemp("runs") / "run"
    assert run(["train", str(scene), "3igs", "--out", str(out), *STEPS, *SMALL, "--quiet", "--lpips"]) == 0
    return open_model(out)


def splats(opened: Opened) -> SplatModel:
    model = opened.stored.model.splats()
    assert model is not None
    return model


def test_finer_steps_take_more_and_lose_less(opened: Opened) -> None:
    model = splats(opened)
    assert isinstance(model.color, Illuminated)
    condensed = CondensedPage(model.color, model)
    tensors = condensed.tensors(model.rendering_tensors())
    coarse, fine = (unpack_tensors(condensed.packed(tensors, coarse)) for coarse in (True, False))
    assert coarse[CODED].shape[1] <= fine[CODED].shape[1] <= 16
    off = [(found[CODED] - tensors[CODED][:, : found[CODED].shape[1]]).abs().max() for found in (coarse, fine)]
    assert off[1] < off[0]


def test_a_page_is_thinned_to_a_budget(opened: Opened) -> None:
    whole = page_for(opened, splats(opened), None, ())
    thinned = page_for(opened, splats(opened), len(whole.document) - 1_500.0, ())
    assert len(thinned.document) <= len(whole.document) - 1_500
    assert thinned.gaussians < whole.gaussians
    assert len(splats_held(opened, thinned.packed)) == thinned.gaussians
    assert fmean(thinned.decibels) > 25


def splats_held(opened: Opened, packed: Packed) -> SplatModel:
    found = model_held(opened, packed).model.splats()
    assert found is not None
    return found


def test_a_model_without_light_yet_is_shared(scene: Path, tmp_path: Path) -> None:
    settings = (*STEPS, *SMALL, "--steps", "10", "--warmup", "1")
    assert run(["train", str(scene), "3igs", "--out", str(tmp_path / "run"), *settings, "--quiet", "--lpips"]) == 0
    shared = share(open_model(tmp_path / "run"), tmp_path / "page.html")
    assert shared.picture_psnr > 45


def test_a_page_shows_one_light(opened: Opened, tmp_path: Path) -> None:
    pack = LightPack(tmp_path / "light.safetensors", "evening", "", Packed({}, {}))
    with pytest.raises(RecipeError, match="--light"):
        share(opened, tmp_path / "page.html", packs=[pack])
    assert not (tmp_path / "page.html").exists()
