#!/bin/sh
# Builds the kernels with the address and undefined-behaviour sanitizers and runs their tests; called by make sanitize.
# ISAS chooses instruction sets, by default the best of this machine and the generic one.
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
for isa in ${ISAS:-best generic}; do
  echo "sanitized kernels, instruction set: $isa"
  [ "$isa" = best ] || export RINGLIGHT_ISA="$isa"
  # Leaks are not asked for: the interpreter keeps what it has until it ends.
  LD_PRELOAD="$preload" ASAN_OPTIONS=detect_leaks=0:abort_on_error=1 UBSAN_OPTIONS=print_stacktrace=1 \
    RINGLIGHT_PATIENCE=3000 OMP_NUM_THREADS=1 PYTHONDONTWRITEBYTECODE=1 "$PYTHON" scripts/sanitized_tests.py "$BUILD/package" "$@"
done
