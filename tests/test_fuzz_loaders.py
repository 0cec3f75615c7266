"""Four thousand damaged files for every loader; ``make fuzz`` takes a million."""

import subprocess
import sys
from pathlib import Path

import pytest

RUN = Path(__file__).parent / "fuzzing" / "run.py"

LOADERS = (
    ("gaussian_ply", "ply_points", "tensor_file", "checkpoint", "recipe", "demo_plan", "report", "colmap"),
    ("model", "scene_json", "image", "true_normals"),
    ("volume", "volume_checkpoint", "train_checkpoint"),
)
"""A process each."""


@pytest.mark.slow
@pytest.mark.skipif(sys.platform == "win32", reason="needs signals")
@pytest.mark.parametrize("names", LOADERS)
def test_no_damaged_file_does_anything_but_be_read_or_refused(names: tuple[str, ...], tmp_path: Path):
    command = [sys.executable, str(RUN), *names, "--count", "4000", "--home", str(tmp_path)]
    done = subprocess.run(command, check=False, capture_output=True, text=True)
    assert done.returncode == 0, done.stdout + done.stderr[-3000:]
    assert [line.split()[0] for line in done.stdout.splitlines()] == list(names)
    assert done.stdout.count(" 0 found") == len(names)


def test_without_the_guided_fuzzer_that_is_said_and_nothing_is_run():
    code = (
        "import runpy, sys; sys.modules['atheris'] = None; "
        f"sys.argv = [{str(RUN)!r}, 'recipe', '--guided', '--count', '1']; "
        f"sys.path.insert(0, {str(RUN.parent)!r}); runpy.run_path(sys.argv[0], run_name='__main__')"
    )
    done = subprocess.run([sys.executable, "-c", code], check=False, capture_output=True, text=True, timeout=100)
    assert done.returncode == 2
    assert "atheris is not installed" in done.stderr
