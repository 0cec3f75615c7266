"""Training steps with Triton's kernels in their places, interpreted, against native ones."""

import dataclasses

import pytest
import torch

import interpreted
from gsplat_torch import torch_gsplat_rasterizer
from ringlight.core import triton_kernels
from ringlight.data import hull
from ringlight.fit.train import Training, train
from ringlight.methods.table import METHODS
from ringlight.rasterize.choose import rasterizer_for
from ringlight.rasterize.contract import Rasterizer
from small_recipes import with_settings
from tiny_scene import tiny_scene

POINTS = 40
"""Gaussians: the interpreter takes a hundred microseconds an operation of a kernel."""

CHOSEN = (
    "ringlight.color.basis_opacities",
    "ringlight.color.drawable",
    "ringlight.color.mirror",
    "ringlight.color.ringlight",
    "ringlight.color.shared_basis",
    "ringlight.color.varying_mirror",
    "ringlight.fields.networks",
    "ringlight.fields.octahedral",
    "ringlight.fields.ring_tables",
    "ringlight.fit.adam",
    "ringlight.rasterize.stored_form",
    "ringlight.shade.reflection_kernel",
)
"""Modules that choose between Triton's kernels and others; the loss has its own test."""


def training(method: str, rasterize: Rasterizer) -> Training:
    scene = tiny_scene(views=4, size=20)
    scene = dataclasses.replace(scene, points=dataclasses.replace(
        scene.points, positions=scene.points.positions[:POINTS], colors=scene.points.colors[:POINTS], normals=None
    ))  # fmt: skip
    ring = {"rank": 4, "position_nodes": 8, "view_nodes": 6}
    settings = {
        "steps": 3,
        "warmup": 0.0,
        "consistency_every": 1,
        "consistency_until": 1.0,
        "light": {"ring": ring, "render_hidden": 16, "modulation_hidden": 16, "gradient_share": 1.0},
        "shader": {"hidden": 16, "levels": (4, 6), "gradient_share": 1.0},
    }
    return with_settings(METHODS[method], settings).build(scene, rasterize, seed=0)


@pytest.mark.skipif(interpreted.HAS_GPU, reason="tests marked cuda run the kernels themselves")
@pytest.mark.parametrize("method", ["ringlight-basis", "ringlight-ring", "ringlight-mirror"])
def test_steps_with_kernels_interpreted(method: str, monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setattr(hull, "FINE_CELLS", 8)
    native = training(method, rasterizer_for("cpu"))
    expected = [progress.loss for progress in train(native)]
    everywhere = lambda *tensors: all(tensor.dtype == torch.float32 for tensor in tensors)  # noqa: E731
    for module in CHOSEN:
        monkeypatch.setattr(f"{module}.runs_triton", everywhere)
    for module, name in (("ringlight.color.ringlight", "kernel_takes"), ("ringlight.shade.reflection", "kernel_takes")):
        monkeypatch.setattr(f"{module}.{name}", lambda *_: False)
    assert triton_kernels.is_installed()
    ours = training(method, torch_gsplat_rasterizer())
    found = [progress.loss for progress in train(ours)]
    assert found == pytest.approx(expected, rel=1e-3)
