"""What ``ringlight render`` writes beside pictures of one eye: numbers, two eyes, all directions, key frames."""

import json
from pathlib import Path

import numpy as np
import pytest
import torch
from command import Command
from refusal import refused
from scenes_on_disk import picture

from ringlight.core.camera import Camera
from ringlight.files.layer_pictures import looking
from ringlight.files.rigs import Stereo
from ringlight.methods.store import load_model
from ringlight.models.splats import SplatModel
from ringlight.rasterize.choose import rasterizer_for


@pytest.fixture
def run(trained: dict[str, Path]) -> Path:
    return trained["3dgs"]


def camera_of(frame: dict) -> Camera:
    matrix = torch.tensor(frame["world_to_camera"])
    return Camera(matrix, tuple(frame["focal"]), tuple(frame["center"]), frame["width"], frame["height"])


def test_depth_and_normals_are_those_of_the_model(run: Path, tmp_path: Path, ringlight: Command) -> None:
    out = tmp_path / "out"
    words = ("--layers", "color", "depth", "normal", "--path", "train", "--frames", "2", "--format", "npy")
    assert ringlight("render", run, *words, "--out", out).code == 0
    record = json.loads((out / "cameras.json").read_text())
    assert (record["rig"], record["format"], len(record["frames"])) == ("pinhole", "npy", 2)
    assert "world units" in record["layers"]["depth"]["meaning"]
    model = load_model(run, rasterizer_for("cpu")).model
    for frame in record["frames"]:
        camera = camera_of(frame)
        wanted = model.layers(camera)
        assert np.array_equal(np.load(out / "depth" / frame["file"]), wanted["depth"][..., 0].numpy())
        assert np.array_equal(np.load(out / "normal" / frame["file"]), wanted["normal"].numpy())
        shown = model.render(camera, torch.ones(3)).color
        assert np.array_equal(np.load(out / "color" / frame["file"]), shown.detach().numpy())


def test_16_bits_say_their_unit(run: Path, tmp_path: Path, ringlight: Command) -> None:
    av = pytest.importorskip("av")
    words = ("--layers", "depth", "--path", "train", "--frames", "1", "--quiet")
    for kind in ("npy", "png16"):
        assert ringlight("render", run, *words, "--format", kind, "--out", tmp_path / kind).code == 0
    record = json.loads((tmp_path / "png16" / "cameras.json").read_text())
    scale = record["layers"]["depth"]["stored"]
    with av.open(str(tmp_path / "png16" / "depth" / "0000.png")) as file:
        stored = next(file.decode(video=0)).to_ndarray().astype(float)
    depth = np.load(tmp_path / "npy" / "depth" / "0000.npy")
    assert depth.max() > 0
    assert abs(scale["low"] + stored * scale["step"] - depth).max() <= 0.51 * scale["step"]
    assert scale["step"] < depth.max() / 10_000


def test_a_folder_of_other_numbers_keeps_what_they_mean(run: Path, tmp_path: Path, ringlight: Command) -> None:
    words = ("--layers", "depth", "--path", "train", "--frames", "1", "--quiet", "--overwrite", "--out", tmp_path / "o")
    for _ in range(2):
        assert ringlight("render", run, *words, "--format", "png16").code == 0
    before = (tmp_path / "o" / "cameras.json").read_bytes()
    for kind in ("npy", "png"):
        refused(ringlight("render", run, *words, "--format", kind), 1, "cameras.json", "choose another folder")
    assert (tmp_path / "o" / "cameras.json").read_bytes() == before


def test_exr_holds_the_same_numbers(run: Path, tmp_path: Path, ringlight: Command) -> None:
    library = pytest.importorskip("OpenEXR")
    words = ("--layers", "depth", "--path", "train", "--frames", "1", "--quiet")
    for kind in ("npy", "exr"):
        assert ringlight("render", run, *words, "--format", kind, "--out", tmp_path / kind).code == 0
    with library.File(str(tmp_path / "exr" / "depth" / "0000.exr"), separate_channels=True) as file:
        assert np.array_equal(file.channels()["Z"].pixels, np.load(tmp_path / "npy" / "depth" / "0000.npy"))


def test_exr_without_its_library_is_one_sentence(
    run: Path, tmp_path: Path, ringlight: Command, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setitem(__import__("sys").modules, "OpenEXR", None)
    refused(ringlight("render", run, "--format", "exr", "--out", tmp_path / "out"), 1, "ringlight[exr]", "npy")
    assert not (tmp_path / "out").exists()


def slanted_wall(run: Path) -> SplatModel:
    """Small, opaque Gaussians on a wall, x = 0.3 y, about the origin: no fog, as the tiny run's model is."""
    model = load_model(run, rasterizer_for("cpu")).model.splats()
    assert model is not None
    across = torch.linspace(-2, 2, 161)
    y, z = torch.meshgrid(across, across, indexing="ij")
    means = torch.stack([0.3 * y, y, z], -1).reshape(-1, 3)
    columns = {name: column[:1].expand(len(means), *column.shape[1:]).clone() for name, column in model.columns.items()}
    columns["means"], columns["log_scales"] = means, torch.full_like(means, -4.0)
    columns["opacity_logits"] = torch.full((len(means),), 6.0)
    model.load_columns(columns)
    return model


def test_two_eyes_see_the_depth_as_disparity(run: Path) -> None:
    """The left eye's depth, carried over by its disparity, is the right eye's depth there."""
    rotation = torch.tensor([[0.0, 1, 0], [0, 0, -1], [-1, 0, 0]])
    matrix = torch.eye(4)
    matrix[:3, :3], matrix[:3, 3] = rotation, -rotation @ torch.tensor([3.0, 0.1, 0.2])
    camera = Camera(matrix, (150.0, 150.0), (60.0, 50.0), 120, 100)
    rig = Stereo(0.3)
    seen = rig.see(looking(slanted_wall(run), torch.ones(3), ("depth",)), camera)
    depth = seen["depth"][..., 0].numpy()
    assert depth.shape == (100, 240)
    assert seen["alpha"].min() > 0.99
    rows, columns = np.mgrid[:100, :120]
    z = depth[:, :120]
    beside = np.rint(columns - 150.0 * 0.3 / z).astype(int)
    inside = beside >= 0
    other = depth[rows[inside], 120 + beside[inside]]
    carried, at_the_same_place = abs(other - z[inside]), abs(depth[:, 120:] - z)[inside]
    assert carried.mean() < 0.01
    assert at_the_same_place.mean() > 0.05, "which is what a wrong disparity would give"


def test_auto_eyes_are_told_and_taken(run: Path, tmp_path: Path, ringlight: Command) -> None:
    words = ("render", run, "--path", "train", "--frames", "1")
    told = ringlight(*words, "--stereo", "auto", "--out", tmp_path / "a")
    assert told.code == 0, told.err
    assert "1 frame of 40x20" in told.err
    taken = told.err.partition("the eyes are: ")[2].split()
    assert ringlight(*words, *taken, "--out", tmp_path / "b").code == 0
    one, two = (picture(tmp_path / name / "color" / "0000.png").astype(int) for name in "ab")
    assert abs(one - two).max() <= 2


@pytest.mark.parametrize("method", ["3dgs", "ringlight-ring"])
def test_the_middle_of_a_panorama_is_what_the_camera_sees(
    method: str, trained: dict[str, Path], tmp_path: Path, ringlight: Command
) -> None:
    words = ("--path", "train", "--frames", "1", "--format", "npy", "--layers", "color", "depth", "--quiet")
    done = ringlight("render", trained[method], *words, "--panorama", "--width", "512", "--out", tmp_path / "all")
    assert done.code == 0, done.err
    record = json.loads((tmp_path / "all" / "cameras.json").read_text())
    assert "ray" in record["layers"]["depth"]["meaning"]
    whole = np.load(tmp_path / "all" / "color" / "0000.npy")
    assert whole.shape == (256, 512, 3)
    # A pinhole whose pixels are as large as the panorama's at its middle.
    camera, model = camera_of(record["frames"][0]), load_model(trained[method], rasterizer_for("cpu")).model
    focal = 512 / (2 * np.pi)
    pinhole = Camera(camera.world_to_camera, (focal, focal), (20.0, 20.0), 40, 40)
    shown = model.render(pinhole, torch.ones(3)).color.detach().numpy()
    middle = whole[118:138, 246:266]
    # Pixels are dilated alike, and bent by less than a tenth of one so near to the middle.
    assert abs(middle - shown[10:30, 10:30]).mean() < 0.01
    assert abs(middle - shown[10:30, 10:30][:, ::-1]).mean() > 2 * abs(middle - shown[10:30, 10:30]).mean()


def test_key_frames_show_what_their_cameras_see(run: Path, tiny: Path, tmp_path: Path, ringlight: Command) -> None:
    document = json.loads((tiny / "transforms_test.json").read_text())
    pose = np.array(document["frames"][0]["transform_matrix"]) @ np.diag([1, -1, -1, 1])
    flight = {
        "ringlight_path": 1,
        "fov": np.degrees(document["camera_angle_x"]),
        "seconds": 1,
        "fps": 4,
        "stops": [{"camera_to_world": pose.tolist()}, {"position": [2, 2, 2], "look_at": [0, 0, 0]}],
    }
    file = tmp_path / "flight.json"
    file.write_text(json.dumps(flight))
    done = ringlight("render", run, "--path", file, "--out", tmp_path / "out")
    assert done.code == 0, done.err
    assert "5 frames of 20x20" in done.err
    shown = picture(tmp_path / "out" / "color" / "0000.png").astype(int)
    measured = picture(next((run / "images" / "test").glob("*r_0*"))).astype(int)
    assert abs(shown - measured).max() <= 1
    flight["stops"][1]["look_at"] = [2, 2, 2]
    file.write_text(json.dumps(flight))
    refused(ringlight("render", run, "--path", file, "--out", tmp_path / "other"), 1, file, "stop 1")
    assert not (tmp_path / "other").exists()


@pytest.mark.parametrize(
    "words",
    [
        ("--stereo", "0"),
        ("--stereo", "nan"),
        ("--stereo", "wide"),
        ("--panorama", "--stereo", "1"),
        ("--panorama", "--zoom", "2"),
        ("--panorama", "--width", "8", "--scale", "2"),
        ("--width", "8", "--scale", "2"),
        ("--overwrite",),
        ("--panorama", "--width", "7"),
        ("--panorama", "--width", "100000"),
        ("--video", "--format", "npy"),
    ],
)
def test_what_cannot_be_made_is_one_sentence(words: tuple[str, ...], run: Path, ringlight: Command) -> None:
    refused(ringlight("render", run, "--path", "train", *words), 1)
    assert not (run / "renders").exists()


def test_a_turntable_is_one_command(run: Path, tmp_path: Path, ringlight: Command) -> None:
    av = pytest.importorskip("av")
    words = ("--path", "orbit", "--frames", "5", "--video", "--stereo", "auto", "--out", tmp_path / "out")
    assert ringlight("render", run, *words).code == 0
    with av.open(str(tmp_path / "out" / "color.mp4")) as film:
        frames = list(film.decode(video=0))
        assert (len(frames), frames[0].width, frames[0].height) == (5, 40, 20)
