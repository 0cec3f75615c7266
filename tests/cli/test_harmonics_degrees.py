"""3dgs of every degree goes through all commands, with as many numbers a Gaussian as its degree has."""

import json
from pathlib import Path

import pytest
import torch
from cli_session import QUICK
from command import Command

from ringlight.files.ply import read_gaussian_ply
from ringlight.files.tensor_file import read_tensors
from ringlight.methods.store import load_model
from ringlight.rasterize.choose import rasterizer_for
from ringlight.runs.resume import resume_run

GEOMETRY_AND_BASE = 14
"""Numbers a Gaussian has without a view: centre 3, scales 3, quaternion 4, opacity 1, constant coefficient 3."""

DEGREE_BYTES = 8
"""The active degree is stored with the model."""


@pytest.mark.parametrize(("degree", "rest"), [(0, 0), (1, 9), (2, 24)])
def test_a_low_degree_goes_through_all_commands(
    degree: int, rest: int, tiny: Path, tmp_path: Path, ringlight: Command
) -> None:
    run = tmp_path / "run"
    words = ("train", tiny, "3dgs", "--sh-degree", degree, "--visible-only", *QUICK)
    assert ringlight(*words, "--out", run).code == 0
    report = json.loads((run / "report.json").read_text())
    assert report["counted"] != 300, "density control was at work"
    assert report["bytes_raw"] == report["counted"] * 4 * (GEOMETRY_AND_BASE + rest) + DEGREE_BYTES

    resumed = resume_run(run).training.model.state_dict()
    stored = read_tensors(run / "model.safetensors").tensors
    assert all(torch.equal(resumed[name], stored[name]) for name in resumed)

    packed, ply = tmp_path / "packed.safetensors", tmp_path / "out.ply"
    for command in (("compress", run, packed, "--quiet"), ("export", run, ply)):
        done = ringlight(*command)
        assert done.code == 0, done.err
    model = load_model(packed, rasterizer_for("cpu")).model
    assert tuple(model.state_dict()["columns.sh_rest"].shape) == (report["counted"], rest // 3, 3)
    assert torch.equal(read_gaussian_ply(ply).gaussians.appearance["sh_rest"], stored["columns.sh_rest"])
