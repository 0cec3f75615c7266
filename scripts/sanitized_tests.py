"""The kernels' tests with a module that was built with sanitizers: ``make sanitize`` runs this, see sanitize.sh.

An editable installation finds its own module before any path, so its finder is taken out first.
"""

import os
import sys
from pathlib import Path

PACKAGE = Path(sys.argv[1]).resolve()

KERNEL_TESTS = (
    "tests/test_kernels.py", "tests/test_fuzz_kernels.py", "tests/rasterize", "tests/contracts", "tests/shade",
    "tests/color", "tests/fields", "tests/fit/test_adam.py", "tests/fit/test_losses.py", "tests/fit/test_densify.py",
    "tests/fit/test_train.py", "tests/models", "tests/volume",
)  # fmt: skip
"""Every test that runs native code on numbers of its own making; those of speed and of files are left out."""


def main() -> int:
    """Run them; pytest's exit code."""
    sys.meta_path[:] = [finder for finder in sys.meta_path if "ScikitBuild" not in type(finder).__name__]
    sys.path.insert(0, str(PACKAGE))
    os.environ["PYTHONPATH"] = str(PACKAGE)  # for what a test starts anew
    import pytest

    from ringlight import _kernels

    assert Path(_kernels.__file__).is_relative_to(PACKAGE), f"{_kernels.__file__} is not the sanitized module"
    # Tests of processes are left out: what they fork or start is not the kernels'.
    elsewhere = "not (forked or process)"
    return int(pytest.main(["-p", "no:cacheprovider", "-x", "-k", elsewhere, *KERNEL_TESTS, *sys.argv[2:]]))


if __name__ == "__main__":
    sys.exit(main())
