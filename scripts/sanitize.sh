#!/bin/sh
# Builds the kernels with the address and undefined-behaviour sanitizers, makes recorded calls of each of them again,
# and runs their tests; called by make sanitize. ISAS chooses instruction sets, by default the best of this machine,
# AVX2 and the generic one; TESTS=no leaves the tests out, which take most of the time.
set -eu
PYTHON=${PYTHON:-.venv/bin/python}
PYTHON="$(cd "$(dirname "$PYTHON")" && pwd)/$(basename "$PYTHON")" # CMake wants it from the root
BUILD=build/sanitize

cmake -S . -B "$BUILD" -G Ninja -DRINGLIGHT_SANITIZE=ON -DPython_EXECUTABLE="$PYTHON" >/dev/null
cmake --build "$BUILD" ${JOBS:+-j "$JOBS"}
rm -rf "$BUILD/package"
mkdir -p "$BUILD/package"
cp -R src/ringlight "$BUILD/package/"
rm -f "$BUILD"/package/ringlight/_kernels*.so
cp "$BUILD"/_kernels*.so "$BUILD/package/ringlight/"

compiler=${CXX:-c++}
preload="$("$compiler" -print-file-name=libasan.so) $("$compiler" -print-file-name=libstdc++.so)"

sanitized() {
  # Leaks are not asked for: the interpreter keeps what it has until it ends.
  LD_PRELOAD="$preload" ASAN_OPTIONS=detect_leaks=0:abort_on_error=1 UBSAN_OPTIONS=print_stacktrace=1 \
    RINGLIGHT_PATIENCE=3000 OMP_NUM_THREADS=1 OPENBLAS_NUM_THREADS=1 PYTHONDONTWRITEBYTECODE=1 "$PYTHON" "$@"
}

others="generic"
[ "$(uname -m)" != x86_64 ] || others="avx2 generic"
# On a processor with a matrix unit the best set leaves out what others of its kind run.
[ "$("$PYTHON" -c 'from ringlight import _kernels; print(_kernels.isa())')" != avx512_amx ] ||
  others="avx512_bf16 $others"
for isa in ${ISAS:-best $others}; do
  echo "sanitized kernels, instruction set: $isa"
  [ "$isa" = best ] || export RINGLIGHT_ISA="$isa"
  "$PYTHON" scripts/recorded_calls.py record "$BUILD/calls.npz"
  sanitized scripts/recorded_calls.py replay "$BUILD/calls.npz" "$BUILD"/_kernels*.so
  [ "${TESTS:-yes}" = no ] || sanitized scripts/sanitized_tests.py "$BUILD/package" "$@"
done
rm "$BUILD/calls.npz"
echo "no finding"
