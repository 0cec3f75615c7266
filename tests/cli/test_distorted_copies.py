"""Scenes photographed through a lens train as well as those of a pinhole (figures: docs/experiments/lenses.md)."""

import json
from pathlib import Path

import pytest
from command import Command

from distorted_copies import COEFFICIENTS, copy_blender, copy_colmap
from shared_data import shared

LOST = 0.1
"""Decibels that undistorting may cost, measured on the pinhole's own test photographs."""

STEPS = 1000


@pytest.mark.slow
@pytest.mark.parametrize("model", COEFFICIENTS)
@pytest.mark.parametrize("scene", ["family_24", "chair_400"])
def test_a_lens_costs_next_to_nothing(scene: str, model: str, tmp_path: Path, ringlight: Command):
    source = shared(f"data/{scene}")
    (copy_colmap if scene == "family_24" else copy_blender)(source, model, tmp_path)
    told = {}
    for copy in ("straight", "bent"):
        run = tmp_path / f"run-{copy}"
        settings = ("--steps", STEPS, "--threads", 1, "--out", run, "--quiet")
        assert ringlight("train", tmp_path / copy, "3dgs", *settings).code == 0
        told[copy] = json.loads(ringlight("eval", run, tmp_path / "straight", "--threads", 1, "--json").out)["psnr"]
    assert told["bent"] > told["straight"] - LOST
