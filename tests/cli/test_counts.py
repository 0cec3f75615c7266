"""Whatever a command says of one thing, it says in the singular."""

import re
from pathlib import Path

import torch
from command import Command
from scenes_on_disk import write_tiny_scene

from ringlight.core.gaussians import Gaussians
from ringlight.files.ply import write_gaussian_ply

ONE_OF_MANY = re.compile(r"(?<![\d.,])1 (?:training |test )?[A-Za-z]{3,}s\b")
"""A number one with a plural behind it."""


def one_gaussian(path: Path) -> Path:
    zeros = torch.zeros(1, 3)
    table = Gaussians(zeros, zeros - 3, torch.tensor([[1.0, 0, 0, 0]]), torch.zeros(1), {})
    write_gaussian_ply(path, table, zeros, torch.zeros(1, 0, 3))
    return path


def test_nothing_that_is_one_has_a_plural(tmp_path: Path, ringlight: Command) -> None:
    scene, run, model = write_tiny_scene(tmp_path / "balls"), tmp_path / "run", tmp_path / "m.safetensors"
    one = ("--holdout", "train/r_0.png", "--steps", "1", "--initial-points", "4", "--threads", "1", "--preview", "1")
    said = [
        ringlight("train", scene, "ringlight-ring", *one, "--light.ring.rank", "2", "--out", run),
        ringlight("train", "--resume", run, "--steps", "1"),
        ringlight("eval", run),
        ringlight("info", run),
        ringlight("compress", run, tmp_path / "small.safetensors", scene),
        ringlight("import", one_gaussian(tmp_path / "one.ply"), model),
        ringlight("info", model),
        ringlight("export", model, tmp_path / "again.ply"),
        ringlight("render", model, "--scene", scene, "--frames", "1", "--threads", "1"),
        ringlight("study", "rank", scene, "--dry-run", "--steps", "1"),
    ]
    for outcome in said:
        assert outcome.code == 0, outcome
        assert not ONE_OF_MANY.search(outcome.out + outcome.err), outcome
