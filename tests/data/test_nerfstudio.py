"""transforms.json: intrinsics in other pixels than the image's, splits, points, lenses."""

import json
from pathlib import Path

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from lenses import judge, undistorted
from scene_folders import FOCAL, HEIGHT, WIDTH, nerfstudio_document, result_or_sentence, write_nerfstudio

from ringlight.core.scene import Scene
from ringlight.data.load import load_scene
from ringlight.data.options import SceneOptions
from ringlight.errors import SceneError

ASCII_PLY = """ply
format ascii 1.0
element vertex 4
property float x
property float y
property float z
property uchar red
property uchar green
property uchar blue
end_header
0 0 0 255 0 0
1 0 0 0 255 0
0 1 0 0 0 255
0 0 1 51 102 153
"""


def test_every_eighth_by_name_is_a_test_image_whatever_the_order(tmp_path: Path):
    document = nerfstudio_document()
    document["frames"].reverse()
    scene = load_scene(write_nerfstudio(tmp_path, document))
    assert [view.name for view in scene.test] == ["images/0000.png", "images/0008.png"]
    assert [view.name for view in scene.train] == [f"images/000{index}.png" for index in range(1, 8)]


def test_intrinsics_are_rescaled_to_the_image(tmp_path: Path):
    document = {**nerfstudio_document(), "w": 4 * WIDTH, "h": 4.0 * HEIGHT, "fl_x": 80, "cx": 30.0, "cy": 26.0}
    document["fl_y"] = 84.0
    camera = load_scene(write_nerfstudio(tmp_path, document)).train[0].camera
    assert (camera.width, camera.height) == (WIDTH, HEIGHT)
    assert camera.focal == pytest.approx((20.0, 21.0))
    assert camera.center == pytest.approx((7.5, 6.5))


def test_a_frame_may_have_its_own_intrinsics(tmp_path: Path):
    document = nerfstudio_document()
    document["frames"][1] |= {"fl_x": 31.0, "fl_y": 32.0, "cx": 5.0}
    views = load_scene(write_nerfstudio(tmp_path, document)).train
    assert views[0].camera.focal == (31.0, 32.0)
    assert views[0].camera.center == (5.0, HEIGHT / 2)
    assert views[1].camera.focal == (FOCAL, FOCAL)


def test_a_frames_own_angle_stands_before_the_files_focal_length(tmp_path: Path):
    document = nerfstudio_document() | {"camera_angle_x": 0.7, "camera_angle_y": 0.6}
    for own, focal in (({"camera_angle_x": 0.8}, 8 / 0.42279322), ({"fl_x": 31.0}, 31.0)):
        frames = [dict(frame) for frame in document["frames"]]
        frames[1] |= own
        views = load_scene(write_nerfstudio(tmp_path, document | {"frames": frames})).train
        assert views[0].camera.focal == pytest.approx((focal, focal))
        assert views[1].camera.focal == (FOCAL, FOCAL)


def test_angles_do_instead_of_focal_lengths(tmp_path: Path):
    document = {**nerfstudio_document(), "camera_angle_x": 0.8, "camera_angle_y": 0.5}
    for key in ("fl_x", "fl_y", "cx", "cy", "w", "h"):
        del document[key]
    camera = load_scene(write_nerfstudio(tmp_path, document)).train[0].camera
    assert camera.focal == pytest.approx((8 / 0.42279322, 6 / 0.25534192))
    del document["camera_angle_y"]
    camera = load_scene(write_nerfstudio(tmp_path, document)).train[0].camera
    assert camera.focal[0] == camera.focal[1]


@pytest.mark.parametrize("size", [(HEIGHT, WIDTH), (3 * HEIGHT, 3 * WIDTH)])
def test_an_image_turned_by_a_quarter_is_refused(tmp_path: Path, size: tuple[int, int]):
    document = nerfstudio_document() | {"w": size[0], "h": size[1]}
    with pytest.raises(SceneError, match="turned by a quarter"):
        load_scene(write_nerfstudio(tmp_path, document))


K = {"k1": -0.2, "k2": 0.05, "p1": 0.002, "p2": -0.001}


@pytest.mark.parametrize(
    ("fields", "model", "coefficients"),
    [
        (K, "OPENCV", (-0.2, 0.05, 0.002, -0.001)),
        (K | {"camera_model": "PINHOLE"}, "OPENCV", (-0.2, 0.05, 0.002, -0.001)),
        ({"camera_model": "SIMPLE_RADIAL", "k1": 0.1}, "OPENCV", (0.1, 0.0, 0.0, 0.0)),
        (
            K | {"camera_model": "FULL_OPENCV", "k3": 0.01, "k4": 0.2, "k5": 0.02, "k6": 0.003}, "FULL_OPENCV",
            (-0.2, 0.05, 0.002, -0.001, 0.01, 0.2, 0.02, 0.003),
        ),
        (
            {"camera_model": "OPENCV_FISHEYE", "k1": 0.05, "k2": 0.02, "k3": -0.01, "k4": 0.004}, "OPENCV_FISHEYE",
            (0.05, 0.02, -0.01, 0.004),
        ),
        ({"camera_model": None, "is_fisheye": True, "k1": 0.05}, "OPENCV_FISHEYE", (0.05, 0.0, 0.0, 0.0)),
        ({"distortion_params": [-0.2, 0.05, 0, 0, 0.002, -0.001]}, "OPENCV", (-0.2, 0.05, 0.002, -0.001)),
        (
            {"camera_model": "OPENCV_FISHEYE", "distortion_params": [0.05, 0.02, -0.01, 0.004, 0.0, 0.0]},
            "OPENCV_FISHEYE", (0.05, 0.02, -0.01, 0.004),
        ),
        ({"camera_model": "RADIAL_FISHEYE", "k1": 0.05, "k2": 0.01}, "RADIAL_FISHEYE", (0.05, 0.01)),
    ],
)  # fmt: skip
@pytest.mark.parametrize("per_frame", [False, True])
def test_photographs_of_a_lens_are_undistorted(
    tmp_path: Path, fields: dict, model: str, coefficients: tuple, per_frame: bool
):
    document = nerfstudio_document()
    del document["camera_model"], document["k1"]
    for entry in document["frames"] if per_frame else [document]:
        entry.update({key: value for key, value in fields.items() if value is not None})
    scene = load_scene(write_nerfstudio(tmp_path, document))
    focals = (FOCAL,) if model == "RADIAL_FISHEYE" else (FOCAL, FOCAL)
    chosen = undistorted(judge(model, (*focals, WIDTH / 2, HEIGHT / 2, *coefficients), WIDTH, HEIGHT))
    for view in (*scene.train, *scene.test):
        assert (view.camera.width, view.camera.height) == (chosen.width, chosen.height)
        assert view.camera.center == pytest.approx((chosen.principal_point_x, chosen.principal_point_y))
        assert view.load().shape == (chosen.height, chosen.width, 3)
    assert any(note.startswith("lens: undistorted (") for note in scene.notes)


def test_one_frame_may_have_a_lens_of_its_own(tmp_path: Path):
    document = nerfstudio_document()
    document["frames"][3] |= {"k1": -0.2}
    views = {view.name: view.camera for split in ("train", "test") for view in getattr(load(tmp_path, document), split)}
    assert {name for name, camera in views.items() if camera.width != WIDTH} == {"images/0003.png"}


def load(tmp_path: Path, document: dict):
    return load_scene(write_nerfstudio(tmp_path, document))


def test_coefficients_that_programs_read_differently_are_refused(tmp_path: Path):
    with pytest.raises(SceneError, match=r"frame 0 .* has k4 and k6 in a lens that is no fisheye.*FULL_OPENCV"):
        load(tmp_path, nerfstudio_document() | {"k4": 0.1, "k6": 0.1})
    with pytest.raises(SceneError, match=r"frame 0 .*'is_fisheye' and the camera model 'OPENCV'"):
        load(tmp_path, nerfstudio_document() | {"is_fisheye": True})


@pytest.mark.parametrize("listed", [[0.1] * 7, "0.1", {"k1": 0.1}, [0.1, "far"], [float("nan")], [[0.1]]])
def test_a_list_of_coefficients_that_is_none_is_refused(tmp_path: Path, listed: object):
    with pytest.raises(SceneError, match="frame 0 "):
        load(tmp_path, nerfstudio_document() | {"k1": 0.0, "distortion_params": listed})


def test_coefficients_by_name_beside_a_list_are_refused(tmp_path: Path):
    with pytest.raises(SceneError, match=r"frame 0 .*'distortion_params' and 'k1', of which one is enough"):
        load(tmp_path, nerfstudio_document() | {"k1": -0.2, "distortion_params": [0.1]})


@pytest.mark.parametrize(
    "lens",
    [
        {"camera_model": "EQUIRECTANGULAR"}, {"camera_model": "FISHEYE624"}, {"ftheta_p0": 1.0}, {"omega": 0.9},
    ],
)  # fmt: skip
def test_a_lens_that_cannot_be_undistorted_is_refused_with_the_remedy(tmp_path: Path, lens: dict):
    with pytest.raises(SceneError, match=r"frame 0 .*undistort the images first \(colmap image_undistorter\)"):
        load_scene(write_nerfstudio(tmp_path, nerfstudio_document() | lens))
    own = nerfstudio_document()
    own["frames"][3] |= lens
    with pytest.raises(SceneError, match="frame 3 "):
        load_scene(write_nerfstudio(tmp_path, own))


@pytest.mark.parametrize(
    ("change", "words"), [({"h": 0.1}, "an image size"), ({"fl_x": 0}, "a focal length"), ({"cx": 1e30}, "a centre")]
)
def test_what_cannot_be_is_named(tmp_path: Path, change: dict, words: str):
    with pytest.raises(SceneError, match=f"has {words} of"):
        load_scene(write_nerfstudio(tmp_path, nerfstudio_document() | change))


@pytest.mark.parametrize("change", [{"fl_x": 0.0}, {"fl_x": -5}, {"cx": 1e30}, {"w": -16}, {"fl_x": "20"}, {"h": 0.1}])
def test_intrinsics_that_cannot_be_are_refused(tmp_path: Path, change: dict):
    with pytest.raises(SceneError, match="frame 0"):
        load_scene(write_nerfstudio(tmp_path, nerfstudio_document() | change))


def test_a_file_without_any_focal_length_is_refused(tmp_path: Path):
    document = nerfstudio_document()
    del document["fl_x"], document["fl_y"]
    with pytest.raises(SceneError, match="neither 'fl_x' nor 'camera_angle_x'"):
        load_scene(write_nerfstudio(tmp_path, document))


def test_listed_splits_are_followed(tmp_path: Path):
    document = nerfstudio_document()
    document["train_filenames"] = ["images/0003.png", "./images/0001.png"]
    document["val_filenames"] = ["images/0005.png"]
    scene = load_scene(write_nerfstudio(tmp_path, document))
    assert [view.name for view in scene.train] == ["images/0003.png", "images/0001.png"]
    assert [view.name for view in scene.test] == ["images/0005.png"]
    document["test_filenames"] = ["images/0006.png", "images/0007.png"]
    assert len(load_scene(write_nerfstudio(tmp_path, document)).test) == 2
    del document["train_filenames"]
    assert len(load_scene(write_nerfstudio(tmp_path, document)).train) == 7


@pytest.mark.parametrize("names", [["images/absent.png"], ["../x.png"], "images/0001.png", [1]])
def test_a_split_that_names_no_frame_is_refused(tmp_path: Path, names: object):
    document = nerfstudio_document() | {"train_filenames": ["images/0003.png"], "test_filenames": names}
    with pytest.raises(SceneError, match="test"):
        load_scene(write_nerfstudio(tmp_path, document))


def test_listed_training_images_alone_train_and_none_is_held_out(tmp_path: Path):
    document = nerfstudio_document() | {"train_filenames": ["images/0003.png", "images/0000.png"]}
    scene = load(tmp_path, document)
    assert [view.name for view in scene.train] == ["images/0003.png", "images/0000.png"]
    assert scene.test == ()
    note = "split: train_filenames of transforms.json, which lists no test images: there are no test views"
    assert note in scene.notes
    held = load_scene(write_nerfstudio(tmp_path, document), SceneOptions(holdout_every=2))
    assert ([view.name for view in held.train], [view.name for view in held.test]) == (
        ["images/0003.png"],
        ["images/0000.png"],
    )
    assert not any("no effect" in note for note in held.notes)
    with pytest.raises(SceneError, match="no training image"):
        load(tmp_path, nerfstudio_document() | {"train_filenames": []})


@pytest.mark.parametrize("key", ["file_path", "camera_model", "mask_path", "ply_file_path", "test_filenames"])
def test_what_no_file_can_be_called_is_not_shown_whole(tmp_path: Path, key: str):
    document, name = nerfstudio_document(), "x" * 100_000
    if key in ("file_path", "mask_path"):
        document["frames"][1][key] = name
    else:
        document[key] = [name] if key == "test_filenames" else name
    with pytest.raises(SceneError, match=r"'x{60}'\.\.\. \(100000 characters\)") as caught:
        load_scene(write_nerfstudio(tmp_path, document))
    assert len(str(caught.value)) < 600


def test_points_come_from_the_ply(tmp_path: Path):
    folder = write_nerfstudio(tmp_path)
    assert len(load_scene(folder).points.positions) == 20_000
    (folder / "sparse_pc.ply").write_text(ASCII_PLY)
    scene = load_scene(folder)
    assert scene.points.positions.tolist() == [[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1]]
    assert scene.points.colors[3].tolist() == pytest.approx([0.2, 0.4, 0.6])
    assert "initial points: 4 from structure from motion" in scene.notes


def test_a_stated_ply_must_exist_inside_the_folder(tmp_path: Path):
    with pytest.raises(SceneError, match=r"'cloud\.ply' do not exist"):
        load_scene(write_nerfstudio(tmp_path, nerfstudio_document() | {"ply_file_path": "cloud.ply"}))
    with pytest.raises(SceneError, match="outside"):
        load_scene(write_nerfstudio(tmp_path, nerfstudio_document() | {"ply_file_path": "../cloud.ply"}))


def test_one_image_cannot_be_split(tmp_path: Path):
    document = nerfstudio_document(1)
    with pytest.raises(SceneError, match="too few to hold one out"):
        load_scene(write_nerfstudio(tmp_path, document, 1))


JSON_VALUES = st.recursive(
    st.none() | st.booleans() | st.integers() | st.floats() | st.text(max_size=8) | st.sampled_from([10**400, -1, "."]),
    lambda inner: st.lists(inner, max_size=3) | st.dictionaries(st.text(max_size=4), inner, max_size=3),
    max_leaves=4,
)
KEYS = [
    "camera_model", "fl_x", "fl_y", "cx", "cy", "w", "h", "k1", "frames", "camera_angle_x", "ply_file_path",
    "train_filenames", "test_filenames", "mask_path", "file_path", "transform_matrix", "is_fisheye",
]  # fmt: skip


@settings(max_examples=200, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(data=st.data())
def test_any_json_is_a_scene_or_one_sentence(tmp_path: Path, data: st.DataObject):
    document = nerfstudio_document(3)
    for _ in range(data.draw(st.integers(1, 3))):
        place = data.draw(st.sampled_from([document, *document["frames"]] if document.get("frames") else [document]))
        key = data.draw(st.sampled_from(KEYS))
        place[key] = data.draw(JSON_VALUES)
        if not isinstance(document["frames"], list) or not all(isinstance(f, dict) for f in document["frames"]):
            break
    if not (tmp_path / "images").exists():
        write_nerfstudio(tmp_path, count=3)
    (tmp_path / "transforms.json").write_text(json.dumps(document))
    result = result_or_sentence(lambda: load_scene(tmp_path, SceneOptions(initial_points=10)))
    if isinstance(result, str):
        assert "\n" not in result
    else:
        assert result.box.isfinite().all()
        assert result.points.positions.isfinite().all()


@settings(max_examples=200, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(cut=st.floats(0, 1), flips=st.lists(st.tuples(st.floats(0, 1), st.integers(0, 255)), max_size=3))
def test_any_bytes_are_a_scene_or_one_sentence(tmp_path: Path, cut: float, flips: list):
    if not (tmp_path / "images").exists():
        write_nerfstudio(tmp_path, count=3)
    data = bytearray(json.dumps(nerfstudio_document(3)).encode())
    for place, value in flips:
        data[min(int(place * len(data)), len(data) - 1)] = value
    (tmp_path / "transforms.json").write_bytes(data[: int(cut * len(data)) + 1] if not flips else data)
    result = result_or_sentence(lambda: load_scene(tmp_path, SceneOptions(initial_points=10)))
    assert isinstance(result, Scene) or "\n" not in result
