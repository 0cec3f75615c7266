#!/bin/sh
# Calls of every kernel, recorded while each method trains, made again under valgrind; called by make valgrind.
# valgrind knows no AVX-512: ISAS chooses among the others.
set -eu
PYTHON=${PYTHON:-.venv/bin/python}
MODULE=${MODULE:-$("$PYTHON" -c "from ringlight import _kernels; print(_kernels.__file__)")}
mkdir -p build
others="generic"
[ "$(uname -m)" != x86_64 ] || others="avx2 generic"
for isa in ${ISAS:-$others}; do
  echo "kernels under valgrind, instruction set: $isa"
  export RINGLIGHT_ISA="$isa"
  "$PYTHON" scripts/recorded_calls.py record build/calls.npz
  # Leaks are not asked for: the interpreter keeps what it has until it ends. Its own allocator would hide all others.
  # Long straight runs of vector code are cut: whole ones exhaust the memory in which valgrind translates them.
  PYTHONMALLOC=malloc OPENBLAS_NUM_THREADS=1 valgrind --quiet --error-exitcode=9 --leak-check=no \
    --vex-guest-max-insns=20 --suppressions=scripts/valgrind.supp \
    "$PYTHON" scripts/recorded_calls.py replay build/calls.npz "$MODULE"
  echo "no finding"
done
rm build/calls.npz
