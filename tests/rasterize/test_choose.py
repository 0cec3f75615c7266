"""Choosing a back end by name."""

import importlib

import pytest

from ringlight.errors import BackendError
from ringlight.rasterize import choose
from ringlight.rasterize.choose import rasterizer_for


def test_reference_is_always_there():
    assert rasterizer_for("reference").name == "reference"


def test_auto_prefers_the_compiled_kernels():
    pytest.importorskip("ringlight._kernels", reason="needs the compiled module")
    assert rasterizer_for("auto").name == "cpu"


def test_unknown_names_are_refused_with_the_known_ones():
    with pytest.raises(BackendError, match=r"'vulkan'.*auto, cpu, reference, cuda"):
        rasterizer_for("vulkan")


def test_cuda_points_to_the_cpu():
    with pytest.raises(BackendError, match="--device cpu"):
        rasterizer_for("cuda")


def test_auto_falls_back_where_the_compiled_module_is_missing(monkeypatch):
    def missing(name: str):
        raise ImportError(f"no {name}")

    monkeypatch.setattr(choose.importlib, "import_module", missing)
    assert rasterizer_for("auto").name == "reference"
    with pytest.raises(BackendError, match="make setup"):
        rasterizer_for("cpu")


def test_a_processor_without_avx2_is_refused_in_one_sentence(monkeypatch):
    class Kernels:
        @staticmethod
        def isa():
            raise RuntimeError("this processor has no AVX2; use the 'reference' rasterizer")

    monkeypatch.setattr(importlib, "import_module", lambda name: Kernels)
    with pytest.raises(BackendError, match="AVX2"):
        rasterizer_for("cpu")
