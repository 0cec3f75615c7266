"""A volume goes through the commands: trained, stopped and resumed, measured, drawn, compared, and refused by name."""

import json
from pathlib import Path

import pytest
from command import Command

from ringlight.data.options import SceneOptions
from ringlight.methods.table import METHODS
from ringlight.runs.start import start_run
from small_recipes import COARSE, with_settings

STEPS = 60
SIZES = {
    "tensorf": ("--first-side", "12", "--last-side", "20", "--rays", "256"),
    "putt": ("--coarsest", "8", "--finest", "16", "--rays", "256", "--scaled", "0.6"),
}


@pytest.mark.parametrize("method", SIZES)
def test_a_volume_goes_through_the_commands(method: str, ringlight: Command, tiny: Path, tmp_path: Path):
    run = tmp_path / "run"
    outcome = ringlight("train", tiny, method, "--out", run, "--steps", STEPS, *SIZES[method], "--lpips", "--json")
    assert outcome.code == 0, outcome.err
    report = json.loads(outcome.out)
    assert report["noun"] == "voxels"
    assert "the volume's box is that of" in outcome.err

    measured = ringlight("eval", run, "--json", "--lpips")
    assert json.loads(measured.out)["psnr"] == report["psnr"]

    layers = ("color", "depth", "alpha", "normal")
    drawn = ringlight("render", run, "--out", tmp_path / "pictures", "--layers", *layers)
    assert drawn.code == 0, drawn.err
    assert all(list((tmp_path / "pictures" / layer).glob("*.png")) for layer in layers)

    told = ringlight("info", run)
    assert f"{report['counted']:,} voxels" in told.out

    for words in (("export", run, tmp_path / "a.ply"), ("share", run, tmp_path / "a.html")):
        refused = ringlight(*words)
        assert refused.code == 1
        assert "Traceback" not in refused.err
        assert not words[-1].exists()

    both = ringlight("export", run, tmp_path / "a.ply", "--mesh", "--points")
    assert both.code == 1
    assert "--mesh and --points are given" in both.err
    fitted = ringlight("export", run, tmp_path / "a.ply", "--mesh", "--fit-steps", "9")
    assert (fitted.code, "--fit-steps is of harmonics" in fitted.err) == (1, True)

    # Stopped after its grid was refined and its rays were chosen, it goes on with the same bits.
    settings = {**COARSE, "steps": STEPS, "bounds": None}
    recipe = with_settings(METHODS[method], settings)
    half = start_run(tmp_path / "half", tiny, method, recipe, SceneOptions(), 0, "auto")
    steps = half.steps()
    for _ in range(31):
        next(steps)
    half.save()
    half.lock.release()
    outcome = ringlight("train", "--resume", tmp_path / "half", "--quiet", "--lpips")
    assert outcome.code == 0, outcome.err
    assert json.loads((tmp_path / "half" / "report.json").read_text())["psnr"] == report["psnr"]
