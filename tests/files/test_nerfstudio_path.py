"""nerfstudio's camera paths: read as nerfstudio reads them; damage is one sentence."""

import json
import math
from pathlib import Path
from typing import Any

import pytest
import torch
from hypothesis import given, settings
from hypothesis import strategies as st
from posed_cameras import assert_rigid

from ringlight.errors import RinglightError, SceneError
from ringlight.files.nerfstudio_path import read_nerfstudio_path

# What the viewer of nerfstudio 1.1 writes, cut to one camera: the pose looks along -y from (0, 4, 0.5), z up.
DOCUMENT: dict[str, Any] = {
    "default_fov": 75.0,
    "default_transition_sec": 2.0,
    "keyframes": [{"matrix": [0.0] * 16, "fov": 50.0, "aspect": 1.7, "override_transition_enabled": False}],
    "camera_type": "perspective",
    "render_height": 540.0,
    "render_width": 960.0,
    "fps": 24.0,
    "seconds": 4.0,
    "is_cycle": False,
    "smoothness_value": 0.0,
    "camera_path": [
        {
            "camera_to_world": [-1.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0, 4.0, 0.0, 1.0, 0.0, 0.5, 0.0, 0.0, 0.0, 1.0],
            "fov": 60.0,
            "aspect": 1.7777777777777777,
        }
    ],
}


def written(folder: Path, **changes: Any) -> Path:
    path = folder / "camera_path.json"
    path.write_text(json.dumps(DOCUMENT | changes))
    return path


def with_frame(**changes: Any) -> dict[str, Any]:
    return {"camera_path": [DOCUMENT["camera_path"][0] | changes]}


def test_a_path_is_read_as_nerfstudio_reads_it(tmp_path: Path) -> None:
    found = read_nerfstudio_path(written(tmp_path), 10)
    (camera,) = found.cameras
    assert found.fps == 24
    assert (camera.width, camera.height) == (960, 540)
    # nerfstudio: the focal length is half the height over the tangent of half the angle, on both axes.
    assert camera.focal == pytest.approx((270 / math.tan(math.radians(30)),) * 2)
    assert camera.center == (480, 270)
    torch.testing.assert_close(camera.position, torch.tensor([0.0, 4.0, 0.5]))
    torch.testing.assert_close(camera.forward, torch.tensor([0.0, -1.0, 0.0]))
    # A point above what it looks at is in the upper half, one towards -x on the right.
    column, row, inside = camera.pixels(torch.tensor([[-0.5, 0.0, 1.0]]))
    assert inside.all()
    assert column.item() > 480
    assert row.item() < 270


def test_rows_of_four_and_a_missing_type_are_understood(tmp_path: Path) -> None:
    flat = DOCUMENT["camera_path"][0]["camera_to_world"]
    rows = [flat[4 * i : 4 * i + 4] for i in range(4)]
    document = DOCUMENT | with_frame(camera_to_world=rows)
    del document["camera_type"], document["fps"]
    path = tmp_path / "p.json"
    path.write_text(json.dumps(document))
    found = read_nerfstudio_path(path, 10)
    expected = read_nerfstudio_path(written(tmp_path), 10).cameras[0]
    assert torch.equal(found.cameras[0].world_to_camera, expected.world_to_camera)
    assert found.fps is None


@pytest.mark.parametrize(
    ("changes", "named"),
    [
        ({"camera_path": []}, "camera_path"),
        ({"camera_path": {}}, "camera_path"),
        ({"camera_path": [3]}, "camera 0"),
        ({"camera_path": DOCUMENT["camera_path"] * 11}, "11 cameras"),
        ({"camera_type": "equirectangular"}, "perspective"),
        ({"camera_type": "\x1b[2J"}, "perspective"),
        ({"render_width": 0}, "render_width"),
        ({"render_width": 1e9}, "render_width"),
        ({"render_height": math.nan}, "render_height"),
        ({"render_height": None}, "render_height"),
        ({"fps": -1}, "fps"),
        ({"fps": 4e-4}, "fps"),
        ({"fps": "fast"}, "fps"),
        (with_frame(fov=0), "fov"),
        (with_frame(fov=180), "fov"),
        (with_frame(fov=math.inf), "fov"),
        (with_frame(fov=True), "fov"),
        (with_frame(camera_to_world=[1.0] * 15), "16 numbers"),
        (with_frame(camera_to_world="x" * 16), "16 numbers"),
        (with_frame(camera_to_world=[1.0] * 16), "last row"),
        (with_frame(camera_to_world=[0.0] * 15 + [1.0]), "flattens"),
        (with_frame(camera_to_world=[math.nan] * 16), "finite"),
        (with_frame(camera_to_world=[10**400] * 16), "finite"),
        (with_frame(camera_to_world=[1.0, 0, 0, 1e300, 0, 1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1]), "finite"),
    ],
)
def test_what_cannot_be_drawn_is_one_sentence(changes: dict[str, Any], named: str, tmp_path: Path) -> None:
    with pytest.raises(SceneError, match=named) as caught:
        read_nerfstudio_path(written(tmp_path, **changes), 10)
    assert str(tmp_path) in str(caught.value)
    assert "\x1b" not in str(caught.value)


@pytest.mark.parametrize("content", [b"", b"[]", b"{", b"\xff\xfe", b"[" * 100_000])
def test_what_is_no_json_object_is_one_sentence(content: bytes, tmp_path: Path) -> None:
    path = tmp_path / "p.json"
    path.write_bytes(content)
    with pytest.raises(SceneError, match=r"p\.json"):
        read_nerfstudio_path(path, 10)
    with pytest.raises(SceneError, match="no such file; give key frames, or"):
        read_nerfstudio_path(tmp_path / "none.json", 10)


VALUES = st.recursive(
    st.none() | st.booleans() | st.integers() | st.floats() | st.text(max_size=5),
    lambda inner: st.lists(inner, max_size=17) | st.dictionaries(st.text(max_size=5), inner, max_size=3),
    max_leaves=20,
)


@settings(max_examples=200)
@given(
    place=st.sampled_from(["camera_path", "camera_type", "render_height", "render_width", "fps", "fov", "matrix"]),
    value=VALUES | st.lists(st.floats(), min_size=16, max_size=16),
)
def test_any_value_is_a_camera_or_a_sentence(place: str, value: Any, tmp_path_factory: pytest.TempPathFactory) -> None:
    changes = {place: value}
    if place in ("fov", "matrix"):
        changes = with_frame(**{"camera_to_world" if place == "matrix" else place: value})
    path = written(tmp_path_factory.mktemp("path"), **changes)
    try:
        cameras = read_nerfstudio_path(path, 10).cameras
    except RinglightError:
        return
    assert_rigid(list(cameras))
    assert all(math.isfinite(number) for camera in cameras for number in camera.focal)
