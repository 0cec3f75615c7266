"""Where ``ringlight render`` lets the camera go: orbits that fit, files of nerfstudio."""

import json
import re
import shutil
from pathlib import Path

import numpy as np
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


def test_what_was_written_is_told_as_json(run: Path, tmp_path: Path, ringlight: Command) -> None:
    arguments = ("--layers", "color", "depth", "--width", "30", "--format", "npy", "--out", str(tmp_path / "new"))
    done = ringlight("render", str(run), *arguments, "--json")
    assert done.code == 0, done.err
    told = json.loads(done.out)
    assert told["folder"] == str(tmp_path / "new")
    assert list(told["layers"]) == ["color", "depth"]
    assert told["films"] == {}
    for folder in told["layers"].values():
        files = {path.name for path in Path(folder).iterdir()}
        assert files == set(told["frames"])
        assert np.load(Path(folder) / min(files)).shape[:2] == (told["height"], told["width"])
    assert told["width"] == 30


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


def turned(axis: int, degrees: float) -> np.ndarray:
    """A rotation of the space about one of its axes."""
    sine, cosine = np.sin(np.radians(degrees)), np.cos(np.radians(degrees))
    matrix, (one, other) = np.eye(4), [row for row in range(3) if row != axis]
    matrix[[one, one, other, other], [one, other, one, other]] = cosine, -sine, sine, cosine
    return matrix


ORIENTED = turned(0, 35.0) @ turned(2, -70.0)
ORIENTED[:3, 3] = [0.4, -1.5, 0.25]
APPLIED = turned(0, -90.0)
APPLIED[:3, 3] = [0.0, 0.5, 0.0]


def moved_by_nerfstudio(document: dict, scale: float) -> dict:
    """The path as nerfstudio's viewer writes it: poses turned and shifted, then their places scaled."""
    document = json.loads(json.dumps(document))  # its frames may be one object
    for frame in document["camera_path"]:
        pose = ORIENTED @ np.array(frame["camera_to_world"]).reshape(4, 4)
        pose[:3, 3] *= scale
        frame["camera_to_world"] = pose.ravel().tolist()
    return document


def as_nerfstudio(scene: Path, folder: Path) -> Path:
    """The tiny scene as one of nerfstudio's that was turned when it was made, and scaled by 4."""
    shutil.copytree(scene, folder)
    document = json.loads((folder / "transforms_train.json").read_text())
    for frame in document["frames"]:
        frame["file_path"] += ".png"
    for name in ("train", "test"):
        (folder / f"transforms_{name}.json").unlink()
    facts = {"applied_transform": APPLIED[:3].tolist(), "applied_scale": 4.0}
    (folder / "transforms.json").write_text(json.dumps(document | facts))
    return folder


@pytest.mark.parametrize("of_nerfstudio", [False, True])
def test_a_path_in_nerfstudios_own_world_is_brought_back(
    of_nerfstudio: bool, run: Path, tiny: Path, tmp_path: Path, ringlight: Command
) -> None:
    flights, scene = tmp_path / "flights", tiny
    flights.mkdir()
    file, beside = flights / "flight.json", flights / "dataparser_transforms.json"
    file.write_text(json.dumps(moved_by_nerfstudio(path_of_first_test_view(tiny), 0.125)))
    told = {"transform": ORIENTED[:3].tolist(), "scale": 0.125}
    if of_nerfstudio:  # whose file says the whole way, from the world before the scene's own was turned and scaled
        scene = as_nerfstudio(tiny, tmp_path / "scene")
        told = {"transform": (ORIENTED @ APPLIED)[:3].tolist(), "scale": 0.125 * 4.0}
    beside.write_text(json.dumps(told))
    done = ringlight("render", run, "--path", file, "--out", tmp_path / "out", "--scene", scene)
    assert done.code == 0, done.err
    assert f"cameras brought back into the scene's world by {beside}" in done.err
    shown = picture(tmp_path / "out" / "color" / "0001.png").astype(int)
    measured = picture(next((run / "images" / "test").glob("*r_0*"))).astype(int)
    assert abs(shown - measured).max() <= 1
    beside.unlink()
    assert ringlight("render", run, "--path", file, "--out", tmp_path / "elsewhere", "--quiet").code == 0
    elsewhere = picture(tmp_path / "elsewhere" / "color" / "0001.png").astype(int)
    assert abs(elsewhere - measured).max() > 5


@pytest.mark.parametrize(
    "damage",
    [
        {"transform": [[1, 2], [3, 4]]},
        {"transform": np.zeros((3, 4)).tolist()},
        {"transform": [[1e200, 0, 0, 0], [0, 1e200, 0, 0], [0, 0, 1e200, 0]]},
        {"scale": 0},
        {"scale": "x"},
    ],
)
def test_a_damaged_frame_of_nerfstudio_is_one_sentence(
    damage: dict, run: Path, tiny: Path, tmp_path: Path, ringlight: Command
) -> None:
    file, beside = tmp_path / "flight.json", tmp_path / "dataparser_transforms.json"
    file.write_text(json.dumps(path_of_first_test_view(tiny)))
    beside.write_text(json.dumps({"transform": np.eye(4)[:3].tolist(), "scale": 1.0} | damage))
    refused(ringlight("render", run, "--path", file), 1, beside, *damage)


def test_a_moved_path_wants_the_scene_that_was_moved(run: Path, tiny: Path, tmp_path: Path, ringlight: Command) -> None:
    gone = Path(shutil.copytree(run, tmp_path / "run"))
    edit_json(gone / "recipe.json", lambda record: record.update(scene=str(tmp_path / "gone")))
    file, beside = tmp_path / "flight.json", tmp_path / "dataparser_transforms.json"
    file.write_text(json.dumps(path_of_first_test_view(tiny)))
    beside.write_text(json.dumps({"transform": np.eye(4)[:3].tolist(), "scale": 1.0}))
    refused(ringlight("render", gone, "--path", file), 1, beside, f"--path {file} --scene FOLDER")
    assert ringlight("render", gone, "--path", file, "--scene", tiny, "--quiet").code == 0


def test_a_film_of_a_nerfstudio_path_is_as_fast_as_the_file_says(
    run: Path, tiny: Path, tmp_path: Path, ringlight: Command
) -> None:
    av = pytest.importorskip("av")
    file = tmp_path / "flight.json"
    file.write_text(json.dumps(path_of_first_test_view(tiny)))
    refused(ringlight("render", run, "--path", file, "--fps", "12"), 1, "--fps", "give --video")
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


def test_what_has_no_effect_is_said(run: Path, tmp_path: Path, ringlight: Command) -> None:
    refused(ringlight("render", run, "--path", "train", "--fps", "2"), 1, "--fps", "give --video")
    for fps in ("1e10", "0.0004"):  # films of which rate there are none
        refused(ringlight("render", run, "--path", "train", "--video", "--fps", fps), 1, "--fps", "0.001 to 1000")
    for frames, told in (("2", False), ("9", True)):
        done = ringlight("render", run, "--frames", frames, "--out", tmp_path / frames)
        assert len(list((tmp_path / frames / "color").iterdir())) == 2
        assert ("--frames asks for 9: there are 2\n" in done.err) == told


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
