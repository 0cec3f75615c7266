"""Options: ranges are checked, and reading them costs no torch."""

import subprocess
import sys

import pytest

from ringlight.data.options import SceneOptions
from ringlight.errors import RecipeError


@pytest.mark.parametrize(
    ("field", "value"),
    [("downscale", 0), ("max_width", 0), ("holdout_every", -1), ("initial_points", 0), ("points_seed", -1)],
)
def test_a_number_out_of_range_is_refused_by_the_name_of_its_flag(field: str, value: int):
    with pytest.raises(RecipeError, match=f"--{field.replace('_', '-')} is {value}: give a whole number of at least"):
        SceneOptions(**{field: value})


def test_options_do_not_import_torch():
    code = "import sys, ringlight.data.options; assert 'torch' not in sys.modules"
    subprocess.run([sys.executable, "-c", code], check=True, env={"PYTHONPATH": ":".join(sys.path)})
