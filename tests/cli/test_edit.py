"""Editing light: a model that every command takes, and sentences for what cannot be edited."""

import json
from pathlib import Path

import pytest
from command import Command
from refusal import refused, snapshot

from ringlight.files.tensor_file import read_metadata


@pytest.mark.parametrize("method", ["3dgs", "ringlight-basis", "ringlight-ring"])
def test_an_edited_run_is_a_model_like_any_other(
    method: str, trained: dict[str, Path], tiny: Path, tmp_path: Path, ringlight: Command
) -> None:
    out = tmp_path / "edited.safetensors"
    done = ringlight("edit", trained[method], out, "--residual", "0.5", "--tint", "#ffcc99", "--quiet")
    assert done.code == 0, done.err
    assert "1, 0.8, 0.6" in done.out
    assert "0.5, 0.4, 0.3" in done.out
    info = ringlight("info", out).out
    assert "residual 0.5,0.4,0.3" in info
    assert json.loads(read_metadata(out)["metrics"]) == {}
    small = tmp_path / "small.safetensors"
    assert ringlight("compress", out, small, "--quiet").code == 0
    assert ringlight("info", small).out.count("base 1,0.8,0.6") == 1
    assert ringlight("eval", out, "--json", "--quiet", "--lpips").code == 0
    frames = tmp_path / "frames"
    assert ringlight("render", small, "--frames", "1", "--out", frames, "--quiet").code == 0
    again = tmp_path / "again.safetensors"
    twice = ringlight("edit", small, again, "--base-only", "--quiet")
    assert f"on top of 1 edit that the model had; ringlight info {again} lists all" in twice.out
    assert "on top" not in done.out
    assert ringlight("info", again).out.count("base 1") == 2
    assert "\n  what depends on the direction times 0, 0, 0\n" in twice.out  # and no word on base colours


def test_what_cannot_be_is_refused_in_a_sentence(trained: dict[str, Path], tmp_path: Path, ringlight: Command) -> None:
    run, out = trained["ringlight-basis"], tmp_path / "edited.safetensors"
    before = snapshot(tmp_path)
    for words, named in (
        (("--residual", "5"), "--residual is 5"),
        (("--residual=-1",), "--residual is -1"),
        (("--residual", "nan"), "--residual is nan"),
        (("--tint", "red?"), "--tint is 'red?'"),
        (("--tint-base", "1,2"), "--tint-base is '1,2'"),
        (("--tint-residual", "1,1,9"), "--tint-residual"),
        (("--tint", "#ffcc00"), "of parts from 1a on"),
        (("--base-only", "--residual", "0.3"), "--base-only"),
        ((), "nothing is to be edited"),
        (("--light", tmp_path / "none"), "none"),
        (("--light", run / "model.safetensors"), "is no light pack"),
    ):
        refused(ringlight("edit", run, out, *words, "--quiet"), 1, named)
    refused(ringlight("edit", run, tmp_path / "edited.html", "--base-only", "--quiet"), 1, ".safetensors")
    refused(ringlight("edit", tmp_path / "nothing", out, "--base-only", "--quiet"), 1, "nothing")
    assert snapshot(tmp_path) == before
    out.write_text("mine")
    refused(ringlight("edit", run, out, "--base-only", "--quiet"), 1, out, "--overwrite")
    assert out.read_text() == "mine"
    assert ringlight("edit", run, out, "--base-only", "--overwrite", "--quiet").code == 0


def test_a_model_of_one_colour_in_all_directions_has_nothing_to_scale(
    tiny: Path, tmp_path: Path, ringlight: Command
) -> None:
    run = tmp_path / "run"
    words = ("--steps", "3", "--initial-points", "100", "--sh-degree", "0", "--quiet", "--lpips")
    assert ringlight("train", tiny, "3dgs", "--out", run, *words).code == 0
    refused(ringlight("edit", run, tmp_path / "a.safetensors", "--residual", "0.5"), 1, "depends on the direction")
    assert ringlight("edit", run, tmp_path / "a.safetensors", "--tint", "1,0.5,0.5", "--quiet").code == 0
