"""A bundled scene goes by its name wherever a folder of photographs is asked for."""

import json
from pathlib import Path

import pytest
from command import Command
from refusal import refused


def test_a_model_is_measured_on_a_bundled_scene(trained: dict[str, Path], ringlight: Command) -> None:
    done = ringlight("eval", trained["3dgs"], "toaster", "--json", "--quiet", "--lpips")
    assert done.code == 0, done.err
    assert json.loads(done.out)["split"] == "50 training, 10 test views"


@pytest.mark.parametrize(
    "words",
    [
        ("compress", "RUN", "OUT.safetensors", "toaster"),
        ("render", "RUN", "--scene", "toaster", "--path", "test", "--out", "OUT", "--scale", "0.1"),
        ("render", "RUN", "--scene", "toaster", "--path", "orbit", "--frames", "1", "--out", "OUT", "--scale", "0.1"),
        ("bench", "step", "--scene", "toaster", "--seconds", "0.1"),
    ],
    ids=lambda words: " ".join(words[:2]) + "".join(word for word in words if word in ("test", "orbit")),
)
def test_other_commands_know_it_too(
    words: tuple[str, ...], trained: dict[str, Path], tmp_path: Path, ringlight: Command
) -> None:
    known = {"RUN": trained["3dgs"], "OUT": tmp_path / "out", "OUT.safetensors": tmp_path / "out.safetensors"}
    done = ringlight(*(known.get(word, word) for word in words))
    assert done.code == 0, done.err


def test_the_world_of_nerfstudio_is_that_of_a_bundled_scene(
    trained: dict[str, Path], tmp_path: Path, ringlight: Command
) -> None:
    unmoved = {"transform": [[1, 0, 0, 0], [0, 1, 0, 0], [0, 0, 1, 0]], "scale": 1.0}
    (tmp_path / "dataparser_transforms.json").write_text(json.dumps(unmoved))
    frame = {"camera_to_world": [1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 4, 0, 0, 0, 1], "fov": 50, "aspect": 1}
    flight = {"render_width": 20, "render_height": 20, "fps": 24, "seconds": 1, "camera_path": [frame]}
    (path := tmp_path / "camera_path.json").write_text(json.dumps(flight))
    words = ("render", trained["3dgs"], "--path", path, "--scene", "toaster", "--out", tmp_path / "out")
    assert ringlight(*words).code == 0


def test_a_name_that_is_nearly_a_bundled_one_is_guessed(trained: dict[str, Path], ringlight: Command) -> None:
    refused(ringlight("eval", trained["3dgs"], "toastr"), 1, "perhaps you meant the bundled scene 'toaster'")
