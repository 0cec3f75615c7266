"""Choosing a back end by name."""

import importlib
import importlib.util
import sys
from types import SimpleNamespace

import pytest

from ringlight.errors import BackendError, FallbackWarning
from ringlight.rasterize import choose
from ringlight.rasterize.choose import rasterizer_for


@pytest.fixture(autouse=True)
def forgotten():
    """What was found out about gsplat in these environments concerns no other test."""
    choose._gsplat_works.cache_clear()
    yield
    choose._gsplat_works.cache_clear()


def test_reference_is_always_there():
    assert rasterizer_for("reference").name == "reference"


def test_auto_prefers_the_compiled_kernels():
    pytest.importorskip("ringlight._kernels", reason="needs the compiled module")
    assert rasterizer_for("auto").name == "cpu"


def test_unknown_names_are_refused_with_the_known_ones():
    with pytest.raises(BackendError, match=r"'vulkan'.*auto, cpu, reference, cuda"):
        rasterizer_for("vulkan")


def test_cuda_without_a_gpu_points_to_the_cpu(monkeypatch):
    monkeypatch.setattr(choose, "has_gpu", lambda: False)
    with pytest.raises(BackendError, match=r"no NVIDIA GPU.*--device cpu"):
        rasterizer_for("cuda")


def test_cuda_without_gsplat_names_the_extra(monkeypatch):
    monkeypatch.setattr(choose, "has_gpu", lambda: True)
    monkeypatch.setitem(sys.modules, "gsplat", None)
    with pytest.raises(BackendError, match=r"ringlight\[cuda\]"):
        rasterizer_for("cuda")


def test_an_old_gsplat_is_refused(monkeypatch):
    monkeypatch.setattr(choose, "has_gpu", lambda: True)
    monkeypatch.setitem(sys.modules, "gsplat", SimpleNamespace(__version__="1.4.0"))
    with pytest.raises(BackendError, match=r"1\.4\.0 is too old, 1\.5\.3"):
        rasterizer_for("cuda")


def gsplat_without_kernels(monkeypatch, kernels: Exception | None) -> list[str]:
    """A GPU and gsplat, whose kernels fail to build with ``kernels``, or are None; returns what will be imported."""
    monkeypatch.setattr(choose, "has_gpu", lambda: True)
    monkeypatch.setattr(importlib.util, "find_spec", lambda name: name)
    monkeypatch.setitem(sys.modules, "gsplat", SimpleNamespace(__version__="1.5.3"))
    asked, others = [], importlib.import_module

    def load(name: str):
        asked.append(name)
        if name != "gsplat.cuda._backend":
            return others(name)
        if kernels is not None:
            raise kernels
        return SimpleNamespace(_C=None)

    monkeypatch.setattr(importlib, "import_module", load)
    return asked


@pytest.mark.parametrize("kernels", [None, RuntimeError("nvcc not found\nmore")])
def test_kernels_that_cannot_be_built_point_to_the_doctor(monkeypatch, kernels):
    gsplat_without_kernels(monkeypatch, kernels)
    with pytest.raises(BackendError, match="ringlight doctor"):
        rasterizer_for("cuda")


def test_a_damaged_gsplat_is_one_sentence(monkeypatch):
    def load(name: str):
        raise OSError("libcudart.so: no such file\nmore")

    monkeypatch.setattr(choose, "has_gpu", lambda: True)
    monkeypatch.setattr(importlib, "import_module", load)
    with pytest.raises(BackendError, match=r"cannot be loaded \(libcudart.so: no such file\); install"):
        rasterizer_for("cuda")


@pytest.mark.parametrize("kernels", [None, RuntimeError("nvcc not found\nmore")])
def test_auto_takes_the_cpu_where_gsplat_cannot_be_built_and_says_why_once(monkeypatch, kernels):
    asked = gsplat_without_kernels(monkeypatch, kernels)
    with pytest.warns(FallbackWarning, match=r"the CPU draws, since .*gsplat.*--device cuda insists") as told:
        assert rasterizer_for("auto").name == "cpu"
    assert len(told) == 1
    assert rasterizer_for("auto").name == "cpu", "without a second warning, which would be an error here"
    assert asked.count("gsplat.cuda._backend") == 1, "a build that failed takes minutes"


def test_cuda_is_what_auto_takes_where_it_can(monkeypatch):
    monkeypatch.setattr(choose, "has_gpu", lambda: True)
    monkeypatch.setattr(importlib.util, "find_spec", lambda name: name)
    monkeypatch.setattr(importlib, "import_module", lambda name: SimpleNamespace(__version__="1.6.0", _C=object()))
    found = rasterizer_for("auto")
    assert found.name == "cuda"
    assert "0.99" in found.note, "1.6 ends opacities elsewhere, and says so"


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
