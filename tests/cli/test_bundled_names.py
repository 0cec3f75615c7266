"""A bundled scene goes by its name wherever a folder of photographs is asked for."""

import json
from pathlib import Path

from command import Command
from refusal import refused


def test_a_model_is_measured_on_a_bundled_scene(trained: dict[str, Path], ringlight: Command) -> None:
    done = ringlight("eval", trained["3dgs"], "toaster", "--json", "--quiet", "--lpips")
    assert done.code == 0, done.err
    assert json.loads(done.out)["split"] == "50 training, 10 test views"


def test_a_name_that_is_nearly_a_bundled_one_is_guessed(trained: dict[str, Path], ringlight: Command) -> None:
    refused(ringlight("eval", trained["3dgs"], "toastr"), 1, "perhaps you meant the bundled scene 'toaster'")
