#!/bin/sh
# Makes $VENV, installs pinned dependencies, builds the compiled module. Called by make setup; prints one sentence
# and stops where the machine lacks something.
set -eu

say() { printf '%s\n' "$*" >&2; }
stop() { say "ringlight: $*"; exit 1; }

command -v "$PYTHON" >/dev/null 2>&1 ||
  stop "no '$PYTHON' on this machine; install Python 3.10 or newer, or name one: make setup PYTHON=/path/to/python3"
"$PYTHON" -c 'import sys; sys.exit(sys.version_info < (3, 10))' ||
  stop "$("$PYTHON" --version 2>&1) is too old; ringlight needs 3.10 or newer: make setup PYTHON=/path/to/python3.11"
"$PYTHON" -c 'import venv, ensurepip' 2>/dev/null ||
  stop "this Python cannot make virtual environments; install its venv package (Debian: apt install python3-venv)"
"$PYTHON" -c 'import os, sys, sysconfig
sys.exit(not os.path.exists(os.path.join(sysconfig.get_path("include"), "Python.h")))' ||
  stop "the headers of this Python are missing; install them (Debian: apt install python3-dev)"
cxx=${CXX:-}
for candidate in c++ g++ clang++; do
  [ -n "$cxx" ] || { command -v "$candidate" >/dev/null 2>&1 && cxx=$candidate; }
done
[ -n "$cxx" ] && command -v "$cxx" >/dev/null 2>&1 ||
  stop "no C++ compiler on this machine; install g++ 11 or newer (Debian: apt install g++), or set CXX"
printf '#include <version>\nint main() { return __cplusplus < 202002L; }\n' |
  "$cxx" -std=c++20 -x c++ -fsyntax-only - 2>/dev/null ||
  stop "the C++ compiler '$cxx' does not know C++20; install g++ 11 or newer, or set CXX"

[ -x "$VENV/bin/python" ] || { say "ringlight: making $VENV"; "$PYTHON" -m venv "$VENV"; }
pip() { "$VENV/bin/python" -m pip --disable-pip-version-check --quiet "$@"; }

torch_version=$(sed -n 's/^torch==//p' constraints.txt)
if ! "$VENV/bin/python" -c "import torch" 2>/dev/null; then
  # The registry's default build brings gigabytes of CUDA: without an NVIDIA GPU take the CPU build where it can be had.
  if command -v nvidia-smi >/dev/null 2>&1 && nvidia-smi -L >/dev/null 2>&1; then
    say "ringlight: installing torch $torch_version for the GPU: gigabytes to download, which takes many minutes"
    pip install "torch==$torch_version"
  else
    say "ringlight: installing torch $torch_version for the CPU: 200 MB to download, which takes minutes"
    cpu_reason=$(PIP_RETRIES=0 pip install --extra-index-url https://download.pytorch.org/whl/cpu \
      "torch==$torch_version+cpu" 2>&1) || {
      say "ringlight: the CPU build is not to be had here; taking the registry's default build, which may be gigabytes"
      pip install "torch==$torch_version" || {
        say "$cpu_reason"
        stop "torch cannot be installed; pip's reasons are above"
      }
    }
  fi
fi
say "ringlight: installing dependencies (with triton, whose kernels the tests interpret: 300 MB, once)"
pip install -c constraints.txt "scikit-build-core" "nanobind" "cmake" "ninja"
say "ringlight: building the kernels"
pip install --no-build-isolation -c constraints.txt --editable ".[dev,sfm,video]"
touch "$STAMP"
say "ringlight: ready"
