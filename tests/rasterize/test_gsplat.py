"""What the CUDA back end is besides a rasterizer: versions of gsplat by name, and the search for built kernels."""

import os

import pytest
import torch

from contracts.raster_cases import random_case
from gsplat_torch import torch_gsplat_rasterizer
from ringlight.errors import BackendError
from ringlight.rasterize import gsplat_build
from ringlight.rasterize.gsplat_seam import Gsplat, numbers_of
from torch_graph import drawn


@pytest.mark.parametrize(
    ("version", "max_alpha", "least"),
    [("1.5.3", 0.999, 0.0), ("1.5.3+pt24cu124", 0.999, 0.0), ("1.6.0", 0.99, 0.005), ("2.0", 0.99, 0.005)],
)
def test_numbers_that_versions_disagree_on(version: str, max_alpha: float, least: float):
    numbers = numbers_of(version)
    assert (numbers.max_alpha, numbers.least_compensation) == (max_alpha, least)


def test_a_newer_projection_has_one_output_more():
    """gsplat 1.6 returns where each view's rows begin, between the rows' numbers and their radii."""
    rows, radii, rest = torch.tensor([4, 7]), torch.ones(2, 2, dtype=torch.int32), torch.zeros(2, 2)

    class Newer:
        __version__ = "1.6.0"

        @staticmethod
        def fully_fused_projection(*_, **__):
            zeros = torch.zeros_like(rows)
            return zeros, zeros, rows, torch.tensor([0, 2]), radii, rest, rest[:, 0], torch.zeros(2, 3), torch.empty(0)

    case = random_case(0)
    table = case.gaussians
    lens = torch.eye(3)[None]
    seen = Gsplat(Newer()).project(
        table.means, table.quats, table.scales, table.opacities, torch.eye(4)[None], lens, (9, 9), case.options
    )
    assert torch.equal(seen.rows, rows)
    assert torch.equal(seen.radii, radii)
    assert seen.compensations is None, "without antialiasing there are none"


def test_too_many_channels_and_other_types_are_refused():
    rasterizer, case = torch_gsplat_rasterizer(), random_case(0)
    with pytest.raises(BackendError, match="up to 512 channels, not 513"):
        drawn(rasterizer, case.gaussians, torch.zeros(80, 513), case.camera, torch.zeros(513))
    with pytest.raises(BackendError, match=r"float32 tensors on cpu, not torch\.float64.*channels"):
        drawn(rasterizer, case.gaussians, case.channels.double(), case.camera, case.background)


def test_kernels_that_torch_has_built_are_found(tmp_path, monkeypatch):
    monkeypatch.setattr(gsplat_build.importlib.util, "find_spec", lambda name: None)
    monkeypatch.setenv("TORCH_EXTENSIONS_DIR", str(tmp_path))
    assert not gsplat_build.is_built()
    (tmp_path / "py311_cu124" / "gsplat_cuda").mkdir(parents=True)
    (tmp_path / "py311_cu124" / "gsplat_cuda" / "gsplat_cuda.so").touch()
    assert gsplat_build.is_built()


@pytest.mark.parametrize(("free", "jobs"), [(1 << 30, 1), (7 << 30, 2), (1 << 40, 10)])
def test_no_more_compilers_than_fit_into_memory(monkeypatch, free: int, jobs: int):
    monkeypatch.setattr(gsplat_build, "free_memory", lambda: free)
    monkeypatch.setattr(os, "cpu_count", lambda: 64)
    assert gsplat_build.safe_jobs() == jobs
    monkeypatch.delenv("MAX_JOBS", raising=False)
    with gsplat_build._few_enough_jobs():
        assert os.environ["MAX_JOBS"] == str(jobs)
    assert "MAX_JOBS" not in os.environ
    monkeypatch.setenv("MAX_JOBS", "5")
    with gsplat_build._few_enough_jobs():
        assert os.environ["MAX_JOBS"] == "5", "somebody knows better"
