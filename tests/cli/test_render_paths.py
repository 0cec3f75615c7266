"""Where ``ringlight render`` lets the camera go: orbits that fit, files of nerfstudio."""

import json
import re
from pathlib import Path

import pytest
from command import Command
from refusal import refused
from scenes_on_disk import edit_json, picture

from ringlight.methods.store import load_model
from ringlight.rasterize.choose import rasterizer_for


@pytest.fixture
def run(trained: dict[str, Path]) -> Path:
    return trained["3dgs"]


def path_of_first_test_view(scene: Path, size: int = 20) -> dict:
    """The first test view as nerfstudio would write it."""
    document = json.loads((scene / "transforms_test.json").read_text())
    pose = document["frames"][0]["transform_matrix"]
    fov = document["camera_angle_x"] * 180 / 3.141592653589793
    frame = {"camera_to_world": [value for row in pose for value in row], "fov": fov, "aspect": 1.0}
    return {
        "camera_type": "perspective",
        "render_height": size,
        "render_width": size,
        "camera_path": [frame, frame],
        "seconds": 2,
        "fps": 1,
    }


def test_a_nerfstudio_path_shows_what_its_cameras_see(
    run: Path, tiny: Path, tmp_path: Path, ringlight: Command
) -> None:
    file = tmp_path / "Flight.json"
    file.write_text(json.dumps(path_of_first_test_view(tiny)))
    done = ringlight("render", run, "--path", file, "--out", tmp_path / "out")
    assert done.code == 0, done.err
    shown = picture(tmp_path / "out" / "color" / "0001.png").astype(int)
    measured = picture(next((run / "images" / "test").glob("*r_0*"))).astype(int)
    assert abs(shown - measured).max() <= 1
    wide = ringlight("render", run, "--path", file, "--out", tmp_path / "wide", "--width", "30", "--frames", "1")
    assert wide.code == 0
    assert picture(tmp_path / "wide" / "color" / "0000.png").shape == (30, 30, 3)


def test_a_film_of_a_nerfstudio_path_is_as_fast_as_the_file_says(
    run: Path, tiny: Path, tmp_path: Path, ringlight: Command
) -> None:
    av = pytest.importorskip("av")
    file = tmp_path / "flight.json"
    file.write_text(json.dumps(path_of_first_test_view(tiny)))
    for words, rate in (((), 1), (("--fps", "12"), 12)):
        out = tmp_path / str(rate)
        assert ringlight("render", run, "--path", file, "--video", "--out", out, *words).code == 0
        with av.open(str(out / "color.mp4")) as film:
            assert film.streams.video[0].average_rate == rate


def test_paths_that_cannot_be_flown_are_refused(run: Path, tiny: Path, tmp_path: Path, ringlight: Command) -> None:
    refused(ringlight("render", run, "--path", "obrit"), 2, "obrit", "orbit", ".json")
    refused(ringlight("render", run, "--path", tmp_path / "none.json"), 1, tmp_path / "none.json")
    file = tmp_path / "flight.json"
    file.write_text(json.dumps(path_of_first_test_view(tiny)))
    edit_json(file, lambda document: document["camera_path"][1].update(fov=1e9))
    refused(ringlight("render", run, "--path", file, "--out", tmp_path / "out"), 1, file, "camera 1", "fov")
    assert not (tmp_path / "out").exists()


@pytest.mark.parametrize(
    "flag",
    [
        ("--radius", "0"),
        ("--radius", "nan"),
        ("--height", "inf"),
        ("--arc", "400"),
        ("--arc", "-1"),
        ("--center", "0", "nan", "0"),
        ("--radius", "1e30"),
    ],
)
def test_orbits_that_are_none_are_refused(flag: tuple[str, ...], run: Path, ringlight: Command) -> None:
    refused(ringlight("render", run, "--path", "orbit", *flag), 1, flag[0])
    assert not (run / "renders").exists()


def test_what_is_of_orbits_is_of_no_other_path(run: Path, ringlight: Command) -> None:
    refused(ringlight("render", run, "--path", "train", "--radius", "2"), 1, "--radius", "--path orbit")


def test_the_numbers_of_an_orbit_are_told_and_taken(run: Path, tmp_path: Path, ringlight: Command) -> None:
    words = ("render", run, "--path", "orbit", "--frames", "4")
    told = ringlight(*words, "--out", tmp_path / "a")
    taken = re.search(r"the orbit is: (.*)", told.err)
    assert taken
    again = ringlight(*words, "--out", tmp_path / "b", *taken[1].split())
    assert again.code == 0, again.err
    for index in range(4):
        one, two = (picture(tmp_path / name / "color" / f"000{index}.png").astype(int) for name in "ab")
        assert abs(one - two).mean() < 1, "but for the rounding of what was told"
    other = ringlight(*words, "--out", tmp_path / "c", *taken[1].split(), "--height", "3")
    assert other.code == 0
    far = picture(tmp_path / "c" / "color" / "0000.png").astype(int)
    assert abs(far - picture(tmp_path / "a" / "color" / "0000.png")).mean() > 1


def test_an_orbit_does_not_cut_a_masked_subject(run: Path, tmp_path: Path, ringlight: Command) -> None:
    """The tiny scene's photographs have masks; an orbit from nearer by would cut its balls at the edges."""
    words = ("render", run, "--path", "orbit", "--frames", "6", "--layers", "alpha", "--radius", "2", "--height", "0")

    def at_edges(folder: Path) -> float:
        frames = [picture(file).astype(float) for file in sorted((folder / "alpha").iterdir())]
        return max(max(f[0].mean(), f[-1].mean(), f[:, 0].mean(), f[:, -1].mean()) for f in frames)

    assert ringlight(*words, "--out", tmp_path / "whole").code == 0
    assert ringlight(*words, "--out", tmp_path / "cut", "--zoom", "1").code == 0
    assert load_model(run, rasterizer_for("cpu")).header.scene.background == "white"
    assert at_edges(tmp_path / "whole") < 0.5 * at_edges(tmp_path / "cut")
