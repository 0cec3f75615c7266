"""Compressing a model: what is written is a model, and says what it cost."""

import json
import shutil
from pathlib import Path

import pytest
import torch
from cli_session import flags
from command import Command
from refusal import refused
from scenes_on_disk import edit_json

from ringlight.core.directions import shortest_axes
from ringlight.files.tensor_file import read_metadata
from ringlight.methods.store import load_model
from ringlight.models.splats import SplatModel
from ringlight.rasterize.choose import rasterizer_for


@pytest.mark.parametrize("method", ["3dgs", "ringlight-basis", "ringlight-ring"])
def test_a_compressed_run_is_a_model_and_its_loss_is_told(
    method: str, trained: dict[str, Path], tmp_path: Path, ringlight: Command
) -> None:
    out = tmp_path / "small.safetensors"
    done = ringlight("compress", trained[method], out, "--quiet")
    assert done.code == 0, done.err
    assert "on 2 test views" in done.out
    told = json.loads(read_metadata(out)["storage"])
    assert told["views"] == 2
    assert told["bytes_after"] < 0.5 * told["bytes_before"]
    most = 0.1 if method == "ringlight-ring" else 0.05  # a ring of 11 dB, after 40 steps, gains 0.06
    assert abs(told["psnr_after"] - told["psnr_before"]) < most
    assert out.stat().st_size < (trained[method] / "model.safetensors").stat().st_size / 2

    report = json.loads((trained[method] / "report.json").read_text())
    assert told["psnr_before"] == pytest.approx(report["psnr"])
    info = ringlight("info", out)
    assert f"{told['psnr_after'] - told['psnr_before']:+.3f} dB on 2 test views" in info.out
    assert "fixed16" in info.out or "fixed24" in info.out
    facts = json.loads(ringlight("info", out, "--json").out)
    [means] = [tensor for tensor in facts["tensors"] if tensor["name"] == "columns.means"]
    assert means["bytes"] == 12 * facts["header"]["counted"] > means["bytes_stored"]
    stored = [tensor for tensor in facts["tensors"] if not tensor["name"].startswith("cameras")]
    assert sum(tensor["bytes_stored"] for tensor in stored) == told["bytes_after"]


def test_every_command_takes_a_compressed_model(
    trained: dict[str, Path], tiny: Path, tmp_path: Path, ringlight: Command
) -> None:
    out = tmp_path / "small.safetensors"
    assert ringlight("compress", trained["ringlight-ring"], out, "--quiet").code == 0
    evaluated = ringlight("eval", out, tiny, "--json", "--quiet", "--lpips")
    psnr = json.loads(evaluated.out)["psnr"]
    assert psnr == pytest.approx(json.loads(read_metadata(out)["storage"])["psnr_after"], abs=1e-4)
    assert ringlight("export", out, tmp_path / "small.ply").code == 0
    frames = ringlight("render", out, "--path", "orbit", "--frames", "2", "--out", tmp_path / "frames", "--quiet")
    assert frames.code == 0, frames.err
    stored = load_model(out, rasterizer_for("reference"))
    assert stored.header.method == "ringlight-ring"


def test_a_model_file_knows_its_scene_and_how_it_was_read(tiny: Path, tmp_path: Path, ringlight: Command) -> None:
    run, small = tmp_path / "run", tmp_path / "small.safetensors"
    words = (*flags(background="black", downscale=2, steps=3, initial_points=100), "--quiet", "--lpips")
    assert ringlight("train", tiny, "3dgs", *words, "--out", run).code == 0
    assert ringlight("compress", run, small, "--quiet").code == 0
    psnr = json.loads(read_metadata(small)["storage"])["psnr_after"]
    asked = ("--json", "--quiet", "--lpips")
    assert json.loads(ringlight("eval", small, *asked).out)["psnr"] == pytest.approx(psnr, abs=1e-4)
    assert json.loads(ringlight("eval", run / "model.safetensors", *asked).out)["background"] == "black"
    assert ringlight("render", small, "--frames", "1", "--out", tmp_path / "frames", "--quiet").code == 0
    refused(ringlight("eval", small, "--downscale", "4", *asked), 1, small, "name its folder")


def test_a_run_whose_scene_was_moved_leaves_its_new_place(
    run_folder: Path, scene_copy: Path, tmp_path: Path, ringlight: Command
) -> None:
    small = tmp_path / "small.safetensors"
    edit_json(run_folder / "recipe.json", lambda record: record.update(scene=str(scene_copy)))
    assert ringlight("compress", run_folder, small, "--quiet").code == 0
    assert json.loads(read_metadata(small)["scene"])["source"] == str(scene_copy)
    shutil.rmtree(scene_copy)
    refused(ringlight("eval", small), 1, scene_copy, "name the folder")
    assert "not measured on photographs" in ringlight("compress", run_folder, tmp_path / "again.safetensors").out
    assert json.loads(read_metadata(small)["metrics"]).keys() == {"psnr"}
    assert json.loads(read_metadata(run_folder / "model.safetensors")["metrics"])["psnr"] is not None
    assert json.loads(read_metadata(tmp_path / "again.safetensors")["metrics"]) == {}, "nobody measured it"


def test_refusals_name_the_remedy_and_write_nothing(
    trained: dict[str, Path], tmp_path: Path, ringlight: Command
) -> None:
    refused(ringlight("compress", trained["3dgs"], tmp_path / "small.zip"), 1, ".safetensors")
    (tmp_path / "there.safetensors").write_text("mine")
    refused(ringlight("compress", trained["3dgs"], tmp_path / "there.safetensors"), 1, "--overwrite")
    refused(ringlight("compress", tmp_path / "missing", tmp_path / "new.safetensors"), 1, tmp_path / "missing")
    refused(ringlight("compress", trained["3dgs"], tmp_path / "n.safetensors", tmp_path / "no"), 1, tmp_path / "no")
    assert [path.name for path in tmp_path.iterdir()] == ["there.safetensors"]
    assert (tmp_path / "there.safetensors").read_text() == "mine"
    small = tmp_path / "small.safetensors"
    assert ringlight("compress", trained["3dgs"], small, "--quiet").code == 0
    packed = small.read_bytes()
    for target in (tmp_path / "again.safetensors", small):
        refused(ringlight("compress", small, target, "--overwrite"), 1, small, "packed already", "keep it")
    assert small.read_bytes() == packed


def test_what_its_training_packed_is_kept_as_it_is(tiny: Path, tmp_path: Path, ringlight: Command) -> None:
    run, small = tmp_path / "run", tmp_path / "small.safetensors"
    words = (*flags(steps=6, initial_points=400), "--quiet", "--lpips")
    assert ringlight("train", tiny, "light-gaussian", *words, "--out", run).code == 0
    refused(ringlight("compress", run, small), 1, run / "model.safetensors", "packed by its training", "keep")
    assert not small.exists()


@pytest.mark.parametrize("method", ["3dgs-dr", "gaussian-shader"])
def test_axes_that_are_normals_stay_where_they_point(
    method: str, tiny: Path, tmp_path: Path, ringlight: Command
) -> None:
    run, small = tmp_path / "run", tmp_path / "small.safetensors"
    made = ringlight("train", tiny, method, *flags(steps=20, initial_points=200), "--quiet", "--out", run, "--lpips")
    assert made.code == 0, made.err
    assert ringlight("compress", run, small, "--quiet").code == 0
    before, after = (_normals(file) for file in (run / "model.safetensors", small))
    assert ((before * after).sum(-1) > 0.999).all()


def _normals(file: Path) -> torch.Tensor:
    model = load_model(file, rasterizer_for("reference")).model
    assert isinstance(model, SplatModel)
    return shortest_axes(model.gaussians, torch.tensor([0.3, 0.2, 4.0]))
