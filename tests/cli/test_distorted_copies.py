"""A scene photographed through a lens trains as well as that of a pinhole. All lenses, several seeds: ``make lenses``,
docs/experiments/lenses.md."""

import json
from pathlib import Path

import pytest
from command import Command

from distorted_copies import copy_blender
from ringlight.data.bundled import bundled_scene

LOST = 0.3
"""Decibels of test PSNR: a seed differs as much from another after so few steps."""


@pytest.mark.slow
def test_a_lens_costs_next_to_nothing(tmp_path: Path, ringlight: Command):
    copy_blender(bundled_scene("carpaint"), "OPENCV", tmp_path)
    told = {}
    for copy in ("straight", "bent"):
        run = tmp_path / f"run-{copy}"
        settings = ("--steps", 400, "--initial-points", 5000, "--threads", 1, "--out", run, "--quiet")
        assert ringlight("train", tmp_path / copy, "3dgs", *settings).code == 0
        told[copy] = json.loads(ringlight("eval", run, tmp_path / "straight", "--threads", 1, "--json").out)["psnr"]
    assert told["bent"] > told["straight"] - LOST
