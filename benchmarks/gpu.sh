#!/bin/sh
# Everything that wants a GPU: builds gsplat's kernels, then tests, parity with the CPU, speed.
# Writes benchmarks/results/gpu-NAME-*.json. PYTHON names another interpreter than .venv's, WORKERS how many processes
# test side by side (4).
set -eu
cd "$(dirname "$0")/.."
python=${PYTHON:-.venv/bin/python}
ringlight() { "$python" -m ringlight "$@"; }

name=$("$python" -c 'import sys, torch
if not torch.cuda.is_available():
    sys.exit("benchmarks/gpu.sh: torch finds no NVIDIA GPU; ringlight doctor says what is missing")
print(torch.cuda.get_device_name().lower().replace(" ", "-"))')

ringlight doctor
# Before the workers, which would build them all at once.
"$python" -c 'from ringlight.rasterize.choose import rasterizer_for; rasterizer_for("cuda")'
"$python" -m pytest -n "${WORKERS:-4}" -m cuda tests
"$python" -m pytest -n "${WORKERS:-4}" tests/*/test_*_triton.py \
  tests/shade/test_reflection_on_gpu.py tests/color/test_basis_emission.py

# --seconds bounds each size, and each method at it.
ringlight bench raster --device cuda --sizes 100k@400 300k@800 --seconds 10 --save "gpu-$name-raster"
ringlight bench raster --device cuda --sizes 300k@800 --channels 11 --seconds 10 --save "gpu-$name-raster-11"
ringlight bench parts --device cuda --sizes 100k@400 300k@800 --seconds 5 --save "gpu-$name-parts"
methods="3dgs ringlight-basis ringlight-ring ringlight-mirror"
for size in 20k@400 100k@400 300k@800; do
  ringlight bench step $methods --device cuda --size "$size" --seconds 5 --save "gpu-$name-step-${size%@*}"
done
ringlight bench fps --device cuda --methods $methods --sizes 100k@400 300k@800 --seconds 5 --save "gpu-$name-fps"
echo "results: benchmarks/results/gpu-$name-*.json"
