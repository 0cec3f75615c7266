"""``ringlight normals``: as far from the truth as the truth was turned, and a sentence for what cannot be compared."""

import json
import shutil
from pathlib import Path

import numpy as np
import pytest
from cli_session import flags
from command import Command
from PIL import Image
from refusal import refused, snapshot

from ringlight.cli.main import run
from ringlight.data.load import load_scene
from ringlight.models.splats import SplatModel
from ringlight.runs.opened import open_model
from true_normals_file import arrays_of, stored, turned, write_truth


@pytest.fixture(scope="module")
def opaque(tiny: Path, tmp_path_factory: pytest.TempPathFactory) -> dict[str, Path]:
    """Runs whose surface is closed: without a reset of opacities."""
    home = tmp_path_factory.mktemp("opaque")
    words = (*flags(steps=100, densify__reset_every=1000), "--quiet", "--lpips")
    for method in ("3dgs", "ringlight-mirror"):
        assert run(["train", str(tiny), method, "--out", str(home / method), *words]) == 0
    return {path.name: path for path in home.iterdir()}


@pytest.fixture
def truth(tiny: Path, tmp_path: Path) -> Path:
    """Of the balls themselves."""
    return write_truth(tmp_path / "truth.npz", load_scene(tiny))


def own_normals(run: Path, tiny: Path) -> np.ndarray:
    """What the model shows at the test views, toward the camera, where it is opaque."""
    model, found = open_model(run).stored.model, []
    for view in load_scene(tiny).test:
        layers = model.layers(view.camera)
        normals = layers["normal"].numpy().astype(np.float64) * (layers["alpha"].numpy() >= 0.9)
        facing = (normals * view.camera.ray_directions().numpy()).sum(-1, keepdims=True) < -0.5
        found.append(normals * facing)
    return np.stack(found)


@pytest.mark.parametrize("degrees", [0.0, 25.0])
def test_a_truth_that_is_turned_is_as_far_away(
    degrees: float, opaque: dict[str, Path], tiny: Path, tmp_path: Path, ringlight: Command
) -> None:
    normals = turned(own_normals(opaque["3dgs"], tiny), degrees)
    path = write_truth(tmp_path / "own.npz", load_scene(tiny), normals=stored(normals))
    done = ringlight("normals", opaque["3dgs"], "--truth", path, "--json", "--quiet")
    assert done.code == 0, done.err
    (found,) = json.loads(done.out)["runs"]
    assert found["mean"] == pytest.approx(degrees, abs=0.01)
    assert found["median"] == pytest.approx(degrees, abs=0.01)
    assert found["within_11_25"] == (1 if degrees < 11.25 else 0)
    assert (found["compared"], found["views"]) == (1.0, 2)
    assert found["pixels"] == np.count_nonzero(normals.any(-1)) > 20
    assert not done.err


def test_several_runs_are_rows_and_views_add_up(
    truth: Path, opaque: dict[str, Path], tmp_path: Path, ringlight: Command
) -> None:
    runs = (opaque["3dgs"], opaque["ringlight-mirror"])
    before = snapshot(*runs)
    shown = ringlight("normals", *runs, "--truth", truth)
    assert shown.code == 0, shown.err
    assert [line.split()[0] for line in shown.out.splitlines()[2:4]] == ["3dgs", "ringlight-mirror"]
    words = ("--truth", truth, "--json", "--threads", "1", "--pictures", tmp_path / "pictures")
    found = json.loads(ringlight("normals", *runs, *words).out)["runs"]
    for one in found:
        counts = [view["pixels"] * view["compared"] for view in one["per_view"]]
        means = [view["mean"] for view in one["per_view"]]
        assert one["mean"] == pytest.approx(np.average(means, weights=counts))
        assert one["pixels"] == sum(view["pixels"] for view in one["per_view"])
        assert [view["name"] for view in one["per_view"]] == ["test/r_0.png", "test/r_1.png"]
        for view in ("test__r_0.png", "test__r_1.png"):
            with Image.open(tmp_path / "pictures" / one["label"] / view) as picture:
                assert picture.width > picture.height > 100
    assert found[1]["mean"] < found[0]["mean"] - 10, "a mirror starts on the surface, with its normals"
    assert snapshot(*runs) == before


def test_progress_counts_the_views_of_all_runs(
    truth: Path, trained: dict[str, Path], ringlight: Command, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("ringlight.cli.stages.BETWEEN_SECONDS", 0.0)
    monkeypatch.setattr("ringlight.cli.stages.LOG_SECONDS", 0.0)
    done = ringlight("normals", trained["3dgs"], trained["ringlight-ring"], "--truth", truth)
    said = done.err.splitlines()
    assert said[:2] == [f"reading {truth}", f"reading {trained['3dgs']}"]
    assert [line for line in said if line.startswith("comparing")] == [f"comparing normals: {i}/4" for i in range(1, 5)]
    assert not ringlight("normals", trained["3dgs"], "--truth", truth, "--quiet").err


def test_a_model_file_and_a_scene_that_moved(
    truth: Path, trained: dict[str, Path], scene_copy: Path, tmp_path: Path, ringlight: Command
) -> None:
    model = Path(shutil.copy(trained["3dgs"] / "model.safetensors", tmp_path / "alone.safetensors"))
    whole = json.loads(ringlight("normals", trained["3dgs"], "--truth", truth, "--json").out)["runs"][0]
    done = ringlight("normals", model, "--truth", truth, "--scene", scene_copy, "--json", "--pictures", tmp_path / "p")
    alone = json.loads(done.out)["runs"][0]
    assert alone["per_view"] == whole["per_view"]
    assert sorted(path.name for path in (tmp_path / "p").iterdir()) == ["test__r_0.png", "test__r_1.png"]


def test_refusals(
    truth: Path, trained: dict[str, Path], tiny: Path, tmp_path: Path, ringlight: Command,
    monkeypatch: pytest.MonkeyPatch,
) -> None:  # fmt: skip
    model, missing = trained["3dgs"], tmp_path / "none"
    assert "no runs are named" in ringlight("normals", "--truth", truth).err
    refused(ringlight("normals", run), 2, "--truth")
    refused(ringlight("normals", model, "--truth", missing), 1, missing)
    refused(ringlight("normals", missing, "--truth", truth), 1, missing)
    refused(ringlight("normals", model, "--truth", truth, "--scene", missing), 1, missing)
    refused(ringlight("normals", model, "--truth", truth, "--pictures", tmp_path), 1, tmp_path, "--pictures")
    refused(ringlight("normals", model, "--truth", truth, "--threads", "-1"), 1, "--threads")
    names = np.array(["r_0", "r_9"])
    strange = write_truth(tmp_path / "strange.npz", load_scene(tiny), names=names)
    refused(ringlight("normals", model, "--truth", strange), 1, strange, "'r_9'", "'test/r_0.png'")
    small = arrays_of(load_scene(tiny))["normals"][:, 1:]
    smaller = write_truth(tmp_path / "smaller.npz", load_scene(tiny), normals=small)
    refused(ringlight("normals", model, "--truth", smaller), 1, "20x19", "20x20")
    layers = SplatModel.layers
    without = lambda self, camera: {k: v for k, v in layers(self, camera).items() if k != "normal"}  # noqa: E731
    monkeypatch.setattr(SplatModel, "layers", without)
    refused(ringlight("normals", model, "--truth", truth), 1, model, "3dgs have no normals")


def test_a_model_without_photographs_says_that_it_needs_them(
    truth: Path, trained: dict[str, Path], tiny: Path, tmp_path: Path, ringlight: Command
) -> None:
    ply, model = tmp_path / "x.ply", tmp_path / "x.safetensors"
    assert ringlight("export", trained["3dgs"], ply).code == 0
    assert ringlight("import", ply, model).code == 0
    refused(ringlight("normals", model, "--truth", truth), 1, model, "--scene FOLDER")
    assert ringlight("normals", model, "--truth", truth, "--scene", tiny).code == 0
