"""A model without Gaussians, plugged in by a line in the table of methods, is a method for every command."""

import json
import sys
from pathlib import Path

import pytest
from command import Command
from PIL import Image

from plugs.voxels import VoxelRecipe
from ringlight.cli.main import run
from ringlight.methods.table import METHODS

STEPS = ("--steps", "60", "--side", "12", "--rays", "256", "--quiet", "--lpips")


@pytest.fixture(autouse=True)
def plugged(monkeypatch: pytest.MonkeyPatch):
    """The line; the command line reads the table when it is imported."""
    monkeypatch.setitem(METHODS, "voxels", VoxelRecipe())
    for module in ("methods", "train"):
        monkeypatch.delitem(sys.modules, f"ringlight.cli.{module}", raising=False)


@pytest.fixture
def voxels(tiny: Path, tmp_path: Path) -> Path:
    folder = tmp_path / "voxels"
    assert run(["train", str(tiny), "voxels", "--out", str(folder), *STEPS]) == 0
    return folder


def test_train_reports_voxels_and_learns(ringlight: Command, tiny: Path, tmp_path: Path):
    reports = {}
    for steps in (1, 150):
        out = tmp_path / str(steps)
        words = ("train", tiny, "voxels", "--out", out, "--quiet", "--lpips", "--json", "--side", 12, "--steps", steps)
        outcome = ringlight(*words)
        assert outcome.code == 0, outcome.err
        reports[steps] = json.loads(outcome.out)
    assert reports[150]["psnr"] > reports[1]["psnr"] + 3
    assert (reports[150]["counted"], reports[150]["noun"]) == (12**3, "voxels")


def test_eval_measures_it_again(ringlight: Command, voxels: Path):
    before = json.loads((voxels / "report.json").read_text())
    outcome = ringlight("eval", voxels, "--json", "--lpips")
    assert outcome.code == 0, outcome.err
    assert json.loads(outcome.out)["psnr"] == before["psnr"]


def test_render_draws_views_and_layers(ringlight: Command, voxels: Path, tmp_path: Path):
    out = tmp_path / "pictures"
    outcome = ringlight("render", voxels, "--out", out, "--layers", "color", "depth", "alpha")
    assert outcome.code == 0, outcome.err
    for layer in ("color", "depth", "alpha"):
        pictures = list((out / layer).glob("*.png"))
        assert pictures
        with Image.open(pictures[0]) as picture:
            assert min(picture.size) > 8


def test_compare_puts_it_beside_gaussians(ringlight: Command, voxels: Path, trained: dict[str, Path]):
    outcome = ringlight("compare", voxels, trained["3dgs"])
    assert outcome.code == 0, outcome.err
    assert "voxels" in outcome.out
    assert "3dgs" in outcome.out


def test_info_says_what_the_file_holds(ringlight: Command, voxels: Path):
    outcome = ringlight("info", voxels)
    assert outcome.code == 0, outcome.err
    assert "1,728 voxels" in outcome.out
    assert "density" in outcome.out


def test_a_stopped_run_resumes_with_the_same_bits(ringlight: Command, voxels: Path, tiny: Path, tmp_path: Path):
    """Stopped by a report of an earlier step: the run's own checkpoint of halfway."""
    from ringlight.data.options import SceneOptions
    from ringlight.runs.start import start_run

    recipe = VoxelRecipe(steps=60, side=12, rays=256)
    options = SceneOptions()
    session = start_run(tmp_path / "half", tiny, "voxels", recipe, options, 0, "auto")
    steps = session.steps()
    for _ in range(31):
        next(steps)
    session.save()
    session.lock.release()
    outcome = ringlight("train", "--resume", tmp_path / "half", "--quiet", "--lpips")
    assert outcome.code == 0, outcome.err
    ours, whole = (json.loads((folder / "report.json").read_text())["psnr"] for folder in (tmp_path / "half", voxels))
    assert ours == whole


def test_export_says_in_a_sentence_that_there_are_no_gaussians(ringlight: Command, voxels: Path, tmp_path: Path):
    outcome = ringlight("export", voxels, tmp_path / "voxels.ply")
    assert outcome.code == 1
    assert "voxels" in outcome.err
    assert "Traceback" not in outcome.err
    assert not (tmp_path / "voxels.ply").exists()


def test_compress_says_in_a_sentence_that_nothing_can_be_packed(ringlight: Command, voxels: Path, tmp_path: Path):
    outcome = ringlight("compress", voxels, tmp_path / "small.safetensors")
    assert outcome.code == 1
    assert "nothing of a voxels model can be packed; keep the file as it is" in outcome.err
    assert "Traceback" not in outcome.err
    assert not (tmp_path / "small.safetensors").exists()


def test_bench_says_in_a_sentence_that_there_are_no_gaussians(ringlight: Command):
    outcome = ringlight("bench", "step", "voxels", "--size", "100@32")
    assert outcome.code == 1
    assert "voxels has no Gaussians, of which the standard workload is; time its step on a --scene" in outcome.err
    assert "Traceback" not in outcome.err
