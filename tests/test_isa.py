"""Every instruction set gives what the slow references give, and no two share code. A process chooses once."""

import importlib.util
import os
import re
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

from ringlight import _kernels

ROOT = Path(__file__).parents[1]

UNKNOWN = "RINGLIGHT_ISA=sse9 is unknown; use generic, avx2, avx512, avx512_bf16 or avx512_amx, or unset it"

KERNEL_TESTS = (
    "contracts/test_rasterizers.py",
    "rasterize/test_cpu.py",
    "rasterize/test_early_stop.py",
    "rasterize/test_fuzz.py",
    "color/test_harmonics.py",
    "color/test_glossy_harmonics.py",
    "color/test_shared_basis.py",
    "color/test_basis_opacities.py",
    "color/test_ring_kernel.py",
    "color/test_ring_emission.py",
    "color/test_drawable.py",
    "color/test_visibility_mask.py",
    "models/test_lazy.py",
    "models/test_way_back.py",
    "models/test_way_back_of_tiles.py",
    "models/test_picture.py",
    "models/test_wants.py",
    "fields/test_perceptron_kernel.py",
    "volume/test_native_march.py",
    "volume/test_shading_kernel.py",
    "volume/test_tt_blocks.py",
    "volume/test_gradient_share.py",
    "color/test_illuminated.py",
    "color/test_mirror_channels.py",
    "color/test_reflective_harmonics.py",
    "color/test_shaded_kernel.py",
    "shade/test_environment.py",
    "shade/test_reflection_kernel.py",
    "fit/test_losses.py",
    "fit/test_adam.py",
    "fit/test_densify.py",
    "test_fuzz_kernels.py",
)
"""Those that hold kernels against a reference or against other kernels. rasterize/test_gradients.py, which holds
gradients against differences, is left out: contracts/test_rasterizers.py holds them against the reference's."""
OF_MATRIX_PRODUCTS = (
    "color/test_ring_kernel.py",
    "color/test_ring_emission.py",
    "color/test_illuminated.py",
    "color/test_mirror_channels.py",
    "fields/test_perceptron_kernel.py",
    "shade/test_reflection_kernel.py",
    "volume/test_shading_kernel.py",
    "volume/test_native_march.py",
    "volume/test_gradient_share.py",
    "models/test_lazy.py",
    "models/test_picture.py",
    "models/test_wants.py",
    "models/test_way_back.py",
    "models/test_way_back_of_tiles.py",
    "test_fuzz_kernels.py",
)
"""What calls those kernels of which there are copies for bfloat16 products (BF16_SOURCES in CMakeLists.txt): where the
suite runs on AVX-512 of any kind, all others are the same."""
# Some that must be among them: to leave out the reference's own tests by name once left these out too.
INDISPENSABLE = (
    "test_equals_the_reference_for_any_number_of_channels[cpu-False-3]",
    "test_equals_the_reference_for_any_image_size[cpu-True-size5]",
    "test_equals_the_reference_on_random_scenes[cpu]",
    "test_lazy_colors_change_no_bit_of_a_step[light0-0.9]",
    "test_kernel_and_reference_equal_torch",
)
OF_MATRIX_PRODUCTS_TOO = INDISPENSABLE[3:4]


def with_isa(name: str, *command: str) -> subprocess.CompletedProcess[str]:
    environment = os.environ | {"RINGLIGHT_ISA": name, "RINGLIGHT_TESTS": "unchecked"}
    return subprocess.run(
        [sys.executable, *command], env=environment, cwd=ROOT, capture_output=True, text=True, check=False
    )


def answer(name: str) -> str:
    code = "from ringlight import _kernels\ntry: print(_kernels.isa())\nexcept RuntimeError as error: print(error)"
    return with_isa(name, "-c", code).stdout.strip()


@pytest.mark.slow
@pytest.mark.parametrize("name", ["generic", "avx2", "avx512", "avx512_bf16", "avx512_amx"])
def test_the_kernels_equal_their_references(name: str):
    if _kernels.isa() == name:
        pytest.skip("the whole suite runs on it already")
    if answer(name) != name:
        pytest.skip(answer(name))
    shares_the_others = name.startswith("avx512") and _kernels.isa().startswith("avx512")
    tests = OF_MATRIX_PRODUCTS if shares_the_others else KERNEL_TESTS
    files = [str(ROOT / "tests" / file) for file in tests]
    options = ("-p", "no:cacheprovider", "-m", "not no_kernel", "-rp")
    done = with_isa(name, "-m", "pytest", *options, *files)
    assert done.returncode == 0, done.stdout[-2000:]
    passed = re.findall(r"^PASSED tests/(.*?)::(.*)", done.stdout, flags=re.MULTILINE)
    assert {file for file, _ in passed} == set(tests)
    wanted = OF_MATRIX_PRODUCTS_TOO if shares_the_others else INDISPENSABLE
    assert {test for _, test in passed} >= set(wanted)
    assert not any("[reference" in test for _, test in passed)


COVERED_BY = {
    "color/test_basis_opacities.py": ("step/basis_opacity",),
    "color/test_drawable.py": ("raster/visibility",),
    "color/test_glossy_harmonics.py": ("step/sh_opacity",),
    "color/test_harmonics.py": ("step/sh", "step/sh_rest"),
    "color/test_illuminated.py": ("illuminated/illuminated", "illuminated/illuminated_gradient", "planes/planes"),
    "color/test_mirror_channels.py": ("reflection/mirror_channels",),
    "color/test_reflective_harmonics.py": ("environment/surface_channels",),
    "color/test_ring_kernel.py": ("ring/ring", "ring/ring_gradient"),
    "color/test_shaded_kernel.py": ("environment/shaded_rows", "environment/sparse_rows"),
    "color/test_shared_basis.py": ("step/sh_basis",),
    "fields/test_perceptron_kernel.py": ("dense/perceptron",),
    "fit/test_adam.py": ("step/adam",),
    "fit/test_densify.py": ("step/screen_gradient",),
    "fit/test_losses.py": ("step/ssim",),
    "models/test_picture.py": ("reflection/reflection_tiles",),
    "rasterize/test_cpu.py": ("raster/blend", "raster/blend_gradient", "raster/project", "raster/project_gradient"),
    "shade/test_environment.py": ("environment/cubemap", "environment/environment"),
    "shade/test_reflection_kernel.py": ("reflection/reflection", "reflection/reflection_gradient"),
    "volume/test_gradient_share.py": ("volume/draw",),
    "volume/test_native_march.py": ("volume/march", "volume/scatter"),
    "volume/test_shading_kernel.py": ("volume/shade",),
    "volume/test_tt_blocks.py": ("trains/bags", "trains/corners", "trains/products"),
}
"""Kernels by the test that holds them against a reference."""

WITHOUT_REFERENCE = {"simd/peak"}
"""The machine's own peak."""


def test_every_kernel_is_held_against_a_reference_on_every_set():
    sources = {file.relative_to(ROOT / "kernels").as_posix() for file in ROOT.glob("kernels/*/*.isa.cpp")}
    if not sources:
        pytest.skip("needs the source tree")
    known = [f"{name}.isa.cpp" for name in (*WITHOUT_REFERENCE, *(n for names in COVERED_BY.values() for n in names))]
    assert sorted(known) == sorted(sources)
    assert set(COVERED_BY) <= set(KERNEL_TESTS)


def test_a_set_that_does_not_exist_is_refused_with_those_that_do():
    assert answer("sse9") == UNKNOWN


def test_what_the_processor_lacks_is_refused_with_the_remedy():
    if answer("avx512_amx") == "avx512_amx":
        pytest.skip("this processor has them all")
    assert answer("avx512_amx").endswith("unset it")


def test_a_set_that_cannot_run_ends_the_command_in_one_sentence():
    done = with_isa("sse9", "-m", "ringlight", "bench", "raster")
    assert done.returncode == 1
    assert done.stderr.strip().endswith(UNKNOWN)
    assert len(done.stderr.strip().splitlines()) == 1


def test_all_kernels_with_copies_for_matrix_products_are_tested_with_them():
    if not (ROOT / "CMakeLists.txt").is_file():
        pytest.skip("needs the source tree")
    listed = re.search(r"set\(BF16_SOURCES\s+(.*?)\)", (ROOT / "CMakeLists.txt").read_text(), flags=re.DOTALL)
    assert listed is not None
    known = (
        "dense/perceptron", "illuminated/illuminated", "illuminated/illuminated_gradient", "reflection/reflection",
        "reflection/reflection_gradient", "reflection/reflection_tiles", "ring/ring", "ring/ring_gradient",
        "volume/shade",
    )  # fmt: skip
    assert sorted(listed[1].split()) == [f"kernels/{name}.isa.cpp" for name in known], "name their tests above too"


@pytest.fixture
def check_isa_symbols():
    """What the build runs on the object files of each instruction set (CMakeLists.txt)."""
    path = ROOT / "cmake" / "check_isa_symbols.py"
    if not path.is_file():
        pytest.skip("needs the source tree")
    spec = importlib.util.spec_from_file_location("check_isa_symbols", path)
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def test_code_outside_the_namespace_of_its_set_is_found(check_isa_symbols):
    own = "0000000000000000 T _ZN9ringlight2v34adamEPfPKfS0_S0_m"
    lambda_of_own = "0000000000000000 W _ZN9ringlight12parallel_forIZN9ringlight2v34adamEvEUlmE_EEvmOT_"
    local, data = "0000000000000040 t _ZL5helpf", "0000000000000000 V _ZN9ringlight5LANESE"
    merged = "0000000000000000 W _ZSt4swapIfEvRT_S1_"
    inline = "0000000000000000 W _ZN9ringlight9plane_sumEPKf"
    listing = "\n".join(["", "adam.cpp.o:", own, lambda_of_own, local, data, merged, inline])
    assert check_isa_symbols.shared_code(listing, "v3") == sorted(
        ["_ZSt4swapIfEvRT_S1_", "_ZN9ringlight9plane_sumEPKf"]
    )
    assert "_ZN9ringlight2v34adamEPfPKfS0_S0_m" in check_isa_symbols.shared_code(own, "v4")


SHARED_INLINE = (
    "inline __attribute__((noinline)) float shared(float x) { return x * x; } float (*user)(float) = shared;"
)


def test_the_build_refuses_an_object_that_would_be_merged(check_isa_symbols, tmp_path, capsys):
    compiler, nm = shutil.which("c++"), shutil.which("nm")
    if compiler is None or nm is None:
        pytest.skip("needs a compiler and nm")
    source, target = tmp_path / "kernel.cpp", tmp_path / "kernel.o"
    source.write_text(SHARED_INLINE, encoding="utf-8")
    subprocess.run([compiler, "-c", str(source), "-o", str(target)], check=True)
    assert check_isa_symbols.main(nm, "v3", str(target)) == 1
    assert "keep it out of *.isa.cpp" in capsys.readouterr().err
