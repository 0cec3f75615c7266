"""COLMAP folders: binary and text agree, cameras project points where COLMAP saw them, damage is one sentence."""

import shlex
import shutil
import struct
from pathlib import Path

import numpy as np
import pytest
import torch
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from lenses import REAL, judge, undistorted
from PIL import Image
from scene_folders import (
    FOCAL,
    HEIGHT,
    WIDTH,
    colmap_names,
    result_or_sentence,
    write_colmap,
    write_colmap_binary,
    write_colmap_text,
    write_image,
    write_nerfstudio,
    write_photographs,
)

from ringlight.core.scene import Scene
from ringlight.data.colmap_model import CAMERA_MODELS
from ringlight.data.colmap_text import read_images
from ringlight.data.load import load_scene
from ringlight.data.options import SceneOptions
from ringlight.errors import SceneError
from shared_data import shared

CUTS = [HealthCheck.function_scoped_fixture]


def assert_same(first: Scene, second: Scene) -> None:
    for a, b in zip((*first.train, *first.test), (*second.train, *second.test), strict=True):
        assert a.name == b.name
        assert torch.equal(a.camera.world_to_camera, b.camera.world_to_camera)
        assert (a.camera.focal, a.camera.center) == (b.camera.focal, b.camera.center)
    assert torch.equal(first.points.positions, second.points.positions)
    assert torch.equal(first.points.colors, second.points.colors)


def test_binary_and_text_are_the_same_scene(tmp_path: Path):
    assert_same(load_scene(write_colmap(tmp_path / "a")), load_scene(write_colmap(tmp_path / "b", text=True)))


def test_images_are_split_by_name_with_their_folders(tmp_path: Path):
    scene = load_scene(write_colmap(tmp_path))
    ordered = sorted(colmap_names(9))
    assert [view.name for view in scene.test] == [ordered[0], ordered[8]]
    assert [view.name for view in scene.train] == ordered[1:8]
    assert len(scene.points.positions) == 6


def test_a_pose_is_world_to_camera(tmp_path: Path):
    scene = load_scene(write_colmap(tmp_path))
    camera = next(view.camera for view in (*scene.train, *scene.test) if view.name == "left/003.png")
    sine, cosine = np.sin(0.3), np.cos(0.3)
    expected = torch.tensor([[cosine, 0, sine, 0.6], [0, 1, 0, 0], [-sine, 0, cosine, 4], [0, 0, 0, 1]])
    assert torch.allclose(camera.world_to_camera, expected.float(), atol=1e-6)


def test_the_model_may_lie_in_sparse_itself(tmp_path: Path):
    write_photographs(tmp_path / "images")
    write_colmap_text(tmp_path / "sparse")
    assert len(load_scene(tmp_path).train) == 7


def test_of_several_models_the_largest_is_used_with_a_warning(tmp_path: Path):
    write_colmap(tmp_path)
    write_colmap_binary(tmp_path / "sparse" / "0", count=2)
    write_colmap_text(tmp_path / "sparse" / "1", count=9)
    write_colmap_binary(tmp_path / "sparse" / "10", count=4)
    scene = load_scene(tmp_path)
    assert len(scene.train) + len(scene.test) == 9
    assert any(note.startswith("warning:") and "0: 2, 1: 9, 10: 4 images" in note for note in scene.notes)


@pytest.mark.parametrize(
    ("name", "number", "parameters"),
    [
        ("SIMPLE_PINHOLE", 0, (FOCAL, 8.0, 6.0)),
        ("SIMPLE_RADIAL", 2, (FOCAL, 8.0, 6.0, 0.0)),
        ("OPENCV", 4, (FOCAL, FOCAL, 8.0, 6.0, 0.0, 0.0, 0.0, 0.0)),
        ("FULL_OPENCV", 6, (FOCAL, FOCAL, 8.0, 6.0, *[0.0] * 8)),
    ],
)
@pytest.mark.parametrize("text", [False, True])
def test_models_without_distortion_are_pinholes(tmp_path: Path, name: str, number: int, parameters: tuple, text: bool):
    scene = load_scene(write_colmap(tmp_path, camera=(name, number, parameters), text=text))
    assert scene.train[0].camera.focal == (FOCAL, FOCAL)
    assert scene.train[0].camera.center == (8.0, 6.0)


NUMBERS = {model.name: number for number, model in CAMERA_MODELS.items()}


def on_small_pictures(parameters: tuple[float, ...], focals: int) -> tuple[float, ...]:
    """The lens on the 16 x 12 pixels of the scene."""
    lengths = focals + 2
    return (*(value / 20 for value in parameters[:lengths]), *parameters[lengths:])


@pytest.mark.parametrize("text", [False, True])
@pytest.mark.parametrize("name", REAL)
def test_photographs_of_a_lens_are_undistorted(tmp_path: Path, name: str, text: bool):
    parameters = on_small_pictures(REAL[name], CAMERA_MODELS[NUMBERS[name]].focals)
    scene = load_scene(write_colmap(tmp_path, camera=(name, NUMBERS[name], parameters), text=text))
    chosen = undistorted(judge(name, parameters, 16, 12))
    for view in (*scene.train, *scene.test):
        camera = view.camera
        assert (camera.width, camera.height) == (chosen.width, chosen.height)
        assert camera.focal == pytest.approx((chosen.focal_length_x, chosen.focal_length_y))
        assert camera.center == pytest.approx((chosen.principal_point_x, chosen.principal_point_y))
        assert view.load().shape == (camera.height, camera.width, 3)
    note = next(note for note in scene.notes if note.startswith("lens: "))
    assert f"undistorted ({name}), which moved pixels by up to" in note


def test_a_lens_that_is_negligible_leaves_photographs_as_they_are(tmp_path: Path):
    scene = load_scene(write_colmap(tmp_path, camera=("SIMPLE_RADIAL", 2, (FOCAL, 8.0, 6.0, 1e-4))))
    assert not any(note.startswith("lens: ") for note in scene.notes)
    view = scene.train[0]
    assert (view.camera.width, view.camera.focal, view.camera.center) == (16, (FOCAL, FOCAL), (8.0, 6.0))
    assert (view.load() == np.array(Image.open(tmp_path / "images" / view.name))).all()


def test_a_lens_is_scaled_with_its_photographs(tmp_path: Path):
    lens = ("OPENCV", 4, on_small_pictures(REAL["OPENCV"], 2))
    write_colmap(tmp_path, camera=lens)
    whole = load_scene(tmp_path).train[0].camera
    half = load_scene(tmp_path, SceneOptions(downscale=2)).train[0]
    assert (half.camera.width, half.camera.height) == (round(whole.width / 2), round(whole.height / 2))
    assert half.camera.focal[0] / half.camera.width == pytest.approx(whole.focal[0] / whole.width)
    assert half.load().shape == (half.camera.height, half.camera.width, 3)
    write_photographs(tmp_path / "images", size=(64, 48))
    large = load_scene(tmp_path).train[0].camera
    assert large.focal == pytest.approx((4 * whole.focal[0], 4 * whole.focal[1]))


def test_a_lens_that_folds_is_refused_with_camera_and_remedy(tmp_path: Path):
    folder = write_colmap(tmp_path, camera=("SIMPLE_RADIAL", 2, (FOCAL, 8.0, 6.0, -3.0)))
    with pytest.raises(SceneError, match=r"bin: image '.*' has a lens \(SIMPLE_RADIAL\) .*; find the cameras"):
        load_scene(folder)


@pytest.mark.parametrize(
    ("name", "number", "parameters"),
    [
        ("FOV", 7, (FOCAL, FOCAL, 8.0, 6.0, 0.5)),
        ("THIN_PRISM_FISHEYE", 10, (FOCAL, FOCAL, 8.0, 6.0, *[0.0] * 8)),
        ("SIMPLE_DIVISION", 12, (FOCAL, 8.0, 6.0, -0.1)),
    ],
)
@pytest.mark.parametrize("text", [False, True])
def test_other_lenses_are_refused_with_the_command(
    tmp_path: Path, name: str, number: int, parameters: tuple, text: bool
):
    folder = write_colmap(tmp_path, camera=(name, number, parameters), text=text)
    command = f"colmap image_undistorter --image_path {folder}/images --input_path {folder}/sparse/0 --output_path"
    with pytest.raises(SceneError, match=f"camera 7 has the camera model '{name}'.*{command}"):
        load_scene(folder)


def test_the_command_that_undistorts_is_quoted(tmp_path: Path):
    folder = write_colmap(tmp_path / "lens space", camera=("FOV", 7, (FOCAL, FOCAL, 8.0, 6.0, 0.5)))
    with pytest.raises(SceneError) as refusal:
        load_scene(folder)
    command, _, train = str(refusal.value).partition("undistort with: ")[2].partition(", and train on ")
    words = shlex.split(command)
    assert words[:2] == ["colmap", "image_undistorter"]
    assert words[2:] == [
        *("--image_path", str(folder / "images"), "--input_path", str(folder / "sparse" / "0")),
        *("--output_path", str(folder / "undistorted")),
    ]
    assert shlex.split(train) == [str(folder / "undistorted")]


def test_an_unknown_model_is_refused(tmp_path: Path):
    with pytest.raises(SceneError, match="camera model number 99"):
        load_scene(write_colmap(tmp_path / "a", camera=("", 99, (1.0,))))
    with pytest.raises(SceneError, match="'PANORAMA'"):
        load_scene(write_colmap(tmp_path / "b", camera=("PANORAMA", 0, (1.0,)), text=True))


@pytest.mark.parametrize("parameters", [(np.nan, 20.0, 8.0, 6.0), (20.0, np.inf, 8.0, 6.0), (0.0, 0.0, 8.0, 6.0)])
def test_a_focal_length_that_cannot_be_is_refused(tmp_path: Path, parameters: tuple):
    with pytest.raises(SceneError, match="camera 7 has a focal length"):
        load_scene(write_colmap(tmp_path, camera=("PINHOLE", 1, parameters)))


@pytest.mark.parametrize("width", ["9" * 310, "-" + "9" * 4000, "9" * 4300, "9" * 4301, "0", str(2**64)])
def test_a_size_that_cannot_be_is_refused(tmp_path: Path, width: str):
    folder = write_colmap(tmp_path, text=True)
    cameras = folder / "sparse" / "0" / "cameras.txt"
    cameras.write_text(cameras.read_text().replace(f" {WIDTH} ", f" {width} "))
    with pytest.raises(SceneError, match=r"cameras\.txt.*(has an image size of|cannot be read)"):
        load_scene(folder)


def test_the_camera_is_scaled_to_the_image(tmp_path: Path):
    write_colmap(tmp_path)
    write_photographs(tmp_path / "images", size=(8, 6))
    camera = load_scene(tmp_path).train[0].camera
    assert (camera.width, camera.height, camera.focal, camera.center) == (8, 6, (10.0, 10.0), (4.0, 3.0))


def test_downscale_takes_the_resized_folder_if_there_is_one(tmp_path: Path):
    write_colmap(tmp_path)
    write_photographs(tmp_path / "images_2", size=(8, 6))
    halved = load_scene(tmp_path, SceneOptions(downscale=2))
    assert "photographs: images_2" in halved.notes
    assert any("as they are" in note for note in halved.notes)
    third = load_scene(tmp_path, SceneOptions(downscale=3))
    assert "photographs: images" in third.notes
    assert any("downscaled to 5x4 by Lanczos" in note for note in third.notes)
    assert halved.train[0].camera.focal == (10.0, 10.0)
    assert third.train[0].camera.focal == pytest.approx((20 * 5 / 16, 20 * 4 / 12))
    assert third.train[0].load().shape == (4, 5, 3)


def test_a_resized_folder_may_have_another_type_of_image(tmp_path: Path):
    write_colmap(tmp_path)
    for name in colmap_names(9):
        write_image((tmp_path / "images_2" / name).with_suffix(".JPG"), (8, 6))
    assert load_scene(tmp_path, SceneOptions(downscale=2)).train[0].load().shape == (6, 8, 3)


def test_a_resized_folder_that_is_not_is_refused(tmp_path: Path):
    write_colmap(tmp_path)
    write_photographs(tmp_path / "images_4")
    refusal = r"images_4/.*png: has 16x12 pixels, which is not 16x12 divided by 4; make images_4 again, or move it away"
    with pytest.raises(SceneError, match=refusal):
        load_scene(tmp_path, SceneOptions(downscale=4))
    write_photographs(tmp_path / "images_4", size=(4, 3))
    assert load_scene(tmp_path, SceneOptions(downscale=4)).train[0].camera.width == 4


@pytest.mark.parametrize("size", [(3, 2), (3, 3), (4, 3), (4, 2)])
def test_sides_of_a_resized_folder_may_be_rounded_either_way(tmp_path: Path, size: tuple[int, int]):
    write_colmap(tmp_path)
    write_photographs(tmp_path / "images_5", size=size)
    assert load_scene(tmp_path, SceneOptions(downscale=5)).train[0].camera.width == size[0]


def test_a_resized_folder_is_held_against_the_photographs_not_the_model(tmp_path: Path):
    """COLMAP may have run on photographs of another size."""
    write_colmap(tmp_path)
    write_photographs(tmp_path / "images", size=(4 * WIDTH, 4 * HEIGHT))
    write_photographs(tmp_path / "images_2", size=(2 * WIDTH, 2 * HEIGHT))
    assert load_scene(tmp_path, SceneOptions(downscale=2)).train[0].camera.width == 2 * WIDTH
    shutil.rmtree(tmp_path / "images")
    with pytest.raises(SceneError, match="is not 16x12 divided by 2"):
        load_scene(tmp_path, SceneOptions(downscale=2))


@pytest.mark.parametrize("name", ["image", "imgs", "rgb", "input", "photos", "frames", "my camera"])
def test_photographs_may_lie_in_another_folder(tmp_path: Path, name: str):
    write_colmap(tmp_path)
    (tmp_path / "images").rename(tmp_path / name)
    (tmp_path / "dense").mkdir()
    scene = load_scene(tmp_path)
    assert f"photographs: {name}" in scene.notes
    assert len(scene.train) == 7


def test_photographs_may_lie_beside_the_model(tmp_path: Path):
    write_photographs(tmp_path)
    write_colmap_binary(tmp_path / "sparse")
    assert len(load_scene(tmp_path).train) == 7


def test_of_several_folders_the_one_with_the_registered_names_is_taken(tmp_path: Path):
    write_colmap(tmp_path)
    (tmp_path / "images").rename(tmp_path / "input")
    write_image(tmp_path / "images" / "cover.png")
    assert "photographs: input" in load_scene(tmp_path).notes
    (tmp_path / "input").rename(tmp_path / "walk")
    assert "photographs: walk" in load_scene(tmp_path).notes
    shutil.copytree(tmp_path / "walk", tmp_path / "normals")
    with pytest.raises(SceneError, match=r"normals and walk both hold the photographs .*--photos"):
        load_scene(tmp_path)
    scene = load_scene(tmp_path, SceneOptions(photos="walk"))
    assert "photographs: walk" in scene.notes
    assert len(load_scene(tmp_path, SceneOptions(photos=str(tmp_path / "normals"))).train) == 7


def test_shrunk_photographs_do_not_stand_in_for_one_that_is_missing(tmp_path: Path):
    """Else a scene trains at half of its resolution because one photograph was lost."""
    write_colmap(tmp_path)
    lost = tmp_path / "images" / colmap_names(9)[2]
    for divided in ("images_2", "images_4"):
        shutil.copytree(tmp_path / "images", tmp_path / divided)
    lost.unlink()
    with pytest.raises(SceneError, match=r"'right/002\.png', which does not exist .*/images \(1 of 9 images missing"):
        load_scene(tmp_path)
    shutil.rmtree(tmp_path / "images")
    shutil.rmtree(tmp_path / "images_4")
    assert "photographs: images_2" in load_scene(tmp_path).notes


def test_photographs_may_lie_outside_the_scene_if_the_user_says_so(tmp_path: Path):
    folder = write_colmap(tmp_path / "scene")
    (folder / "images").rename(tmp_path / "elsewhere")
    scene = load_scene(folder, SceneOptions(photos=str(tmp_path / "elsewhere")))
    assert f"photographs: {tmp_path / 'elsewhere'}" in scene.notes
    with pytest.raises(SceneError, match="nowhere: no such folder"):
        load_scene(folder, SceneOptions(photos="nowhere"))
    with pytest.raises(SceneError, match=r"transforms\.json names the photographs; leave --photos images out"):
        load_scene(write_nerfstudio(tmp_path / "other"), SceneOptions(photos="images"))


def test_missing_images_are_counted(tmp_path: Path):
    write_colmap(tmp_path)
    for name in colmap_names(9)[2:5]:
        (tmp_path / "images" / name).unlink()
    with pytest.raises(SceneError, match=r"'right/002\.png', which does not exist .*3 of 9 images missing"):
        load_scene(tmp_path)


def test_a_missing_folder_or_file_is_named(tmp_path: Path):
    write_colmap_binary(tmp_path / "sparse" / "0")
    with pytest.raises(SceneError, match="no folder 'images'"):
        load_scene(tmp_path)
    (tmp_path / "sparse" / "0" / "images.bin").unlink()
    with pytest.raises(SceneError, match=r"images\.bin: cannot be read"):
        load_scene(tmp_path)


def test_a_model_of_no_images_is_refused(tmp_path: Path):
    with pytest.raises(SceneError, match="registers no images"):
        load_scene(write_colmap(tmp_path, count=0))


@pytest.mark.parametrize("points", [0, 3])
def test_too_few_points_become_random_ones(tmp_path: Path, points: int):
    write_photographs(tmp_path / "images")
    write_colmap_binary(tmp_path / "sparse", points=points)
    scene = load_scene(tmp_path, SceneOptions(initial_points=50))
    assert len(scene.points.positions) == 50
    (tmp_path / "sparse" / "points3D.bin").unlink()
    assert len(load_scene(tmp_path, SceneOptions(initial_points=50)).points.positions) == 50


def test_an_image_name_that_leaves_the_folder_is_refused(tmp_path: Path):
    write_colmap(tmp_path, text=True)
    file = tmp_path / "sparse" / "0" / "images.txt"
    file.write_text(file.read_text().replace("left/003.png", "../../003.png"))
    with pytest.raises(SceneError, match="outside"):
        load_scene(tmp_path)


@pytest.mark.parametrize(
    "numbers", ["nan 0 0 0 0 0 4", "0 0 0 0 0 0 4", "1 0 0 0 0 inf 4", "1 0 0 0 1e300 0 4", "0 0 0 0 0 0 0"]
)
def test_a_pose_that_cannot_be_is_refused_with_its_image(tmp_path: Path, numbers: str):
    write_colmap(tmp_path, text=True)
    file = tmp_path / "sparse" / "0" / "images.txt"
    file.write_text(file.read_text().replace("1.0 0.0 0.0 0.0 0.0 0.0 4.0", numbers))
    with pytest.raises(SceneError, match=r"image 'right/000\.png' has a pose"):
        load_scene(tmp_path)


@pytest.mark.parametrize("file", ["cameras.bin", "images.bin", "points3D.bin"])
def test_a_binary_file_cut_at_any_byte_is_one_sentence(tmp_path: Path, file: str):
    folder = write_colmap(tmp_path, count=2)
    path = folder / "sparse" / "0" / file
    whole = path.read_bytes()
    for length in range(len(whole)):
        path.write_bytes(whole[:length])
        with pytest.raises(SceneError, match=file.replace(".", r"\.")) as caught:
            load_scene(folder)
        assert "\n" not in str(caught.value)
    path.write_bytes(whole + b"\0")
    with pytest.raises(SceneError, match="1 byte too many"):
        load_scene(folder)


@pytest.mark.parametrize("file", ["cameras.bin", "images.bin", "points3D.bin"])
@pytest.mark.parametrize("count", [3, 2**31, 2**63, 2**64 - 1])
def test_an_absurd_count_allocates_nothing(tmp_path: Path, file: str, count: int):
    folder = write_colmap(tmp_path, count=2)
    path = folder / "sparse" / "0" / file
    path.write_bytes(struct.pack("<Q", count) + path.read_bytes()[8 : 8 + 51 * 2])
    with pytest.raises(SceneError, match=r"copy the file again"):
        load_scene(folder)


@settings(max_examples=200, suppress_health_check=CUTS)
@given(
    file=st.sampled_from(["cameras", "images", "points3D"]),
    suffix=st.sampled_from([".bin", ".txt"]),
    place=st.floats(0, 1, exclude_max=True),
    value=st.integers(0, 255) | st.none(),
)
def test_a_damaged_file_is_a_scene_or_one_sentence(
    tmp_path: Path, file: str, suffix: str, place: float, value: int | None
):
    folder = tmp_path / suffix
    path = folder / "sparse" / "0" / (file + suffix)
    write = write_colmap_text if suffix == ".txt" else write_colmap_binary
    if not folder.exists():
        write_photographs(folder / "images", 3)
    write(path.parent, 3)
    data = bytearray(path.read_bytes())
    index = int(place * len(data))
    if value is None:
        data = data[:index]
    else:
        data[index] = value
    path.write_bytes(data)
    result = result_or_sentence(lambda: load_scene(folder, SceneOptions(initial_points=10)))
    assert isinstance(result, Scene) or "\n" not in result


def test_numbers_near_the_end_of_their_range_do_no_harm(tmp_path: Path):
    write_colmap(tmp_path, text=True)
    file = tmp_path / "sparse" / "0" / "images.txt"
    plain = load_scene(tmp_path)
    file.write_text(file.read_text().replace("1.0 0.0 0.0 0.0", "-1e300 0 0 0"))
    assert_same(load_scene(tmp_path), plain)
    points = file.with_name("points3D.txt")
    points.write_text(points.read_text().replace("1 0.0 ", "1 1e38 "))
    assert len(load_scene(tmp_path).points.positions) == 5


@pytest.mark.parametrize("before", ["\ufeff", "  ", "\t", "\ufeff \t"])
def test_text_may_begin_with_a_mark_and_comments_may_be_indented(tmp_path: Path, before: str):
    plain = load_scene(write_colmap(tmp_path, text=True))
    for path in (tmp_path / "sparse" / "0").iterdir():
        comment, records = path.read_text().split("\n", 1)
        path.write_text(f"{before}{comment}\n{records}", encoding="utf-8")
    assert_same(load_scene(tmp_path), plain)
    path.write_text(f"{before}{comment.replace(': ', ': 1')}\n{records}", encoding="utf-8")
    with pytest.raises(SceneError, match="says that it holds"):
        load_scene(tmp_path)


def test_text_without_its_last_records_is_refused(tmp_path: Path):
    folder = write_colmap(tmp_path, text=True)
    path = folder / "sparse" / "0" / "points3D.txt"
    path.write_text("\n".join(path.read_text().split("\n")[:3]) + "\n")
    with pytest.raises(SceneError, match="says that it holds 6 records but holds 2"):
        load_scene(folder)


@pytest.mark.parametrize("name", ["photo.png", "1 2.png", "my photo 1.png", "1 2 3.png"])
def test_images_without_the_lines_of_their_observations_are_refused(tmp_path: Path, name: str):
    """As a tool leaves them that drops empty lines; each other image would be taken for observations."""
    pose = "1.0 0.0 0.0 0.0 0.0 0.0 4.0 7"
    path = tmp_path / "images.txt"
    path.write_text("".join(f"{index} {pose} {index}/{name}\n" for index in (1, 2, 3)))
    with pytest.raises(
        SceneError, match=r"images\.txt, line 2: stands in place of the observations .*; put an empty line"
    ):
        read_images(path)
    path.write_text("".join(f"{index} {pose} {index}/{name}\n\n" for index in (1, 2, 3)))
    assert [image.name for image in read_images(path)] == [f"{index}/{name}" for index in (1, 2, 3)]


@pytest.mark.parametrize("line", ["", "  ", "\r", "1.5 2.5 -1", "1.5 2.5 1 3e2 4.5 18446744073709551615", "nan nan 7"])
def test_observations_are_passed_over(tmp_path: Path, line: str):
    (tmp_path / "images.txt").write_text(f"1 1 0 0 0 0 0 4 7 a.png\n{line}\n2 1 0 0 0 0 0 4 7 b.png\n")
    assert [image.name for image in read_images(tmp_path / "images.txt")] == ["a.png", "b.png"]


def observations(path: Path) -> dict[str, list[tuple[float, float, int]]]:
    """By image name: x, y in pixels and point id of every observation that has a point; a reader of its own."""
    data, found = path.read_bytes(), {}
    (count,), place = struct.unpack_from("<Q", data), 8
    for _ in range(count):
        end = data.index(b"\0", place + 64)
        (seen,) = struct.unpack_from("<Q", data, end + 1)
        rows = [struct.unpack_from("<ddq", data, end + 9 + 24 * index) for index in range(seen)]
        found[data[place + 64 : end].decode()] = [row for row in rows if row[2] >= 0]
        place = end + 9 + 24 * seen
    return found


def point_ids(path: Path) -> list[int]:
    data = path.read_bytes()
    (count,), place, ids = struct.unpack_from("<Q", data), 8, []
    for _ in range(count):
        ids.append(struct.unpack_from("<Q", data, place)[0])
        place += 51 + 8 * struct.unpack_from("<Q", data, place + 43)[0]
    return ids


def test_points_project_to_where_colmap_saw_them():
    folder = shared("data/family_24")
    scene = load_scene(folder)
    seen = observations(folder / "sparse" / "0" / "images.bin")
    row_of = {point: row for row, point in enumerate(point_ids(folder / "sparse" / "0" / "points3D.bin"))}
    assert len(row_of) == len(scene.points.positions)
    for view in (*scene.train, *scene.test):
        camera, marks = view.camera, seen[view.name]
        points = scene.points.positions[[row_of[point] for _, _, point in marks]]
        local = points @ camera.world_to_camera[:3, :3].T + camera.world_to_camera[:3, 3]
        assert (local[:, 2] > 0).all()
        pixels = local[:, :2] / local[:, 2:] * torch.tensor(camera.focal) + torch.tensor(camera.center)
        errors = (pixels - torch.tensor([[x, y] for x, y, _ in marks])).norm(dim=1)
        assert errors.median() < 1
        assert errors.mean() < 2
