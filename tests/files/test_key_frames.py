"""A flight through key frames: every stop at its time, smoothly; damage is one sentence."""

import json
import math
from pathlib import Path

import numpy as np
import pytest
import torch
from hypothesis import given, settings
from hypothesis import strategies as st
from posed_cameras import assert_rigid, camera_at

from ringlight.errors import SceneError
from ringlight.files.key_frame_flight import flown, frame_times
from ringlight.files.key_frames import KeyFrames, holds_key_frames, read_key_frames, write_key_frames

LIKE = camera_at(torch.tensor([3.0, 0.0, 1.0]), torch.zeros(3))
UP = np.array([0.0, 0.0, 1.0])

LOOKING = {
    "ringlight_path": 1,
    "fov": 40,
    "width": 60,
    "height": 40,
    "stops": [
        {"position": [3, 0, 1], "look_at": [0, 0, 0]},
        {"position": [0, 3, 1.5], "look_at": [0, 0, 0.2], "fov": 50},
        {"position": [-3, 0, 1], "look_at": [0.1, 0, 0]},
        {"position": [0, -4, 2], "look_at": [0, 0, 0]},
    ],
}


@pytest.fixture
def written(tmp_path: Path):
    def write(document: object) -> Path:
        file = tmp_path / "flight.json"
        file.write_text(json.dumps(document))
        return file

    return write


def read(file: Path) -> KeyFrames:
    return read_key_frames(file, LIKE, UP)


def matrix_of(camera) -> list:
    return torch.linalg.inv(camera.world_to_camera.double()).tolist()


def test_every_stop_is_passed_at_its_time(written) -> None:
    document = LOOKING | {
        "stops": [dict(s, time=t) for s, t in zip(LOOKING["stops"], (1.0, 1.5, 4.0, 9.0), strict=True)]
    }
    flight = read(written(document))
    assert flight.seconds == 8
    cameras = flown(flight, np.array([0.0, 0.5, 3.0, 8.0]))
    for camera, stop in zip(cameras, document["stops"], strict=True):
        torch.testing.assert_close(
            camera.position, torch.tensor(stop["position"], dtype=torch.float32), atol=1e-4, rtol=0
        )
        column, row, inside = camera.pixels(torch.tensor([stop["look_at"]], dtype=torch.float32))
        assert (abs(column - 30) <= 1, abs(row - 20) <= 1, inside) == (True, True, True)
        assert camera.focal[1] == pytest.approx(20 / math.tan(math.radians(stop.get("fov", 40)) / 2), rel=1e-5)
        assert (camera.width, camera.height) == (60, 40)
    assert_rigid(cameras)


def test_matrices_are_the_cameras_they_are(written) -> None:
    cameras = [camera_at(torch.tensor([3.0, 0.5 * i, 1.0]), torch.tensor([0.0, 0.1 * i, 0.0])) for i in range(4)]
    flight = read(written({"ringlight_path": 1, "stops": [{"camera_to_world": matrix_of(c)} for c in cameras]}))
    found = flown(flight, np.array([stop.time for stop in flight.stops]))
    for one, other in zip(found, cameras, strict=True):
        torch.testing.assert_close(one.world_to_camera, other.world_to_camera, atol=1e-4, rtol=0)
        assert one.focal[1] == pytest.approx(LIKE.focal[1])
        assert (one.width, one.height) == (64, 48)


def velocity(flight: KeyFrames, time: float, step: float) -> np.ndarray:
    before, after = flown(flight, np.array([time, time + step]))
    return (after.position - before.position).double().numpy() / step


@pytest.mark.parametrize("closed", [False, True])
def test_velocity_does_not_jump_at_a_stop(written, closed: bool) -> None:
    times = (0.0, 0.5, 3.0, 4.0)
    stops = [dict(s, time=t) for s, t in zip(LOOKING["stops"], times, strict=True)]
    flight = read(written(LOOKING | {"stops": stops, "closed": closed} | ({"seconds": 5.5} if closed else {})))
    step = 0.01
    for time in times[1:-1] if not closed else times[1:]:
        across = velocity(flight, time - step, step) - velocity(flight, time, step)
        assert np.linalg.norm(across) < 0.03 * max(np.linalg.norm(velocity(flight, time, step)), 4.0)
    if closed:
        across = velocity(flight, 5.5 - step, step) - velocity(flight, 0.0, step)
        assert np.linalg.norm(across) < 0.05 * np.linalg.norm(velocity(flight, 0.0, step))


def test_a_closed_flight_ends_where_it_begins(written) -> None:
    flight = read(written(LOOKING | {"closed": True, "seconds": 10}))
    times = frame_times(flight, None, 3.0, 1000)
    assert len(times) == 30
    first, last = flown(flight, np.array([0.0, 10.0]))
    torch.testing.assert_close(first.world_to_camera, last.world_to_camera, atol=1e-4, rtol=0)
    assert times[-1] < 10


def test_frames_by_seconds_and_by_number(written) -> None:
    flight = read(written(LOOKING))
    assert flight.seconds == 6, "two seconds from stop to stop"
    assert len(frame_times(flight, None, 30.0, 1000)) == 181
    assert frame_times(flight, 4, 30.0, 1000).tolist() == [0, 2, 4, 6]
    for fps in (30.0, 1e308):
        with pytest.raises(SceneError, match="at most 100"):
            frame_times(flight, None, fps, 100)
    alone = read(written(LOOKING | {"stops": LOOKING["stops"][:1]}))
    assert len(frame_times(alone, None, 30.0, 1000)) == 1
    assert len(flown(alone, np.array([0.0]))) == 1


@settings(max_examples=30, deadline=None)
@given(
    st.lists(
        st.tuples(st.floats(-5, 5), st.floats(-5, 5), st.floats(-1, 1), st.floats(0.05, 5)), min_size=1, max_size=6
    ),
    st.booleans(),
)
def test_any_flight_is_rigid_and_finite(tmp_path_factory, rows, closed: bool) -> None:
    time, stops = 0.0, []
    for x, y, z, gap in rows:
        camera = camera_at(torch.tensor([x + 8, y, z]), torch.zeros(3))
        stops.append({"camera_to_world": matrix_of(camera), "time": time})
        time += gap
    file = tmp_path_factory.mktemp("flight") / "flight.json"
    file.write_text(json.dumps({"ringlight_path": 1, "stops": stops, "closed": closed}))
    flight = read(file)
    assert_rigid(flown(flight, frame_times(flight, 20, 30.0, 100)))


def change(**values: object) -> dict:
    return LOOKING | values


def stop_with(**values: object) -> dict:
    return LOOKING | {"stops": [*LOOKING["stops"][:2], LOOKING["stops"][2] | values]}


@pytest.mark.parametrize(
    ("document", "words"),
    [
        (change(ringlight_path=2), "ringlight_path"),
        (change(stops=[]), "stops"),
        (change(stops="x"), "stops"),
        (change(stops=[7]), "stop 0"),
        (change(width=0), "width"),
        (change(height=1e9), "height"),
        (change(fov=180), "fov"),
        (change(fps=0), "fps"),
        (change(fps=4e-4), "fps"),
        (change(clsoed=True), "clsoed"),
        (stop_with(look_At=[0, 0, 0]), "look_At"),
        (change(closed=3), "closed"),
        (change(up=[0, 0, 0]), "up"),
        (change(seconds=-1), "seconds"),
        (change(seconds=1e9), "seconds"),
        (stop_with(position=[1, 2]), "stop 2"),
        (stop_with(position=[1, 2, "x"]), "stop 2"),
        (stop_with(position=[1, 2, 1e300]), "stop 2"),
        (stop_with(look_at=[-3, 0, 1]), "its own place"),
        (stop_with(camera_to_world=[[1]]), "alone"),
        (stop_with(time=1), "time"),
        (stop_with(fov=float("nan")), "fov"),
        (change(stops=[{"camera_to_world": np.zeros((4, 4)).tolist()}]), "stop 0"),
        (change(stops=[{"position": [0, 0, 0]}]), "look_at"),
    ],
)
def test_damage_is_one_sentence(written, document: dict, words: str) -> None:
    file = written(document)
    with pytest.raises(SceneError, match=words) as error:
        read(file)
    assert str(error.value).startswith(str(file))


@pytest.mark.parametrize("closed", [False, True])
def test_a_flight_of_many_stops_that_says_no_seconds_is_asked_for_them(closed: bool, written) -> None:
    stops = [LOOKING["stops"][index % 4] for index in range(1802)]
    with pytest.raises(SceneError, match=r"its 1802 stops take 360[24] seconds by 2 from each to the next; add 'secon"):
        read(written(change(stops=stops, closed=closed)))
    assert read(written(change(stops=stops, closed=closed, seconds=3600))).seconds == 3600
    assert read(written(change(stops=stops[:1800], closed=closed))).seconds <= 3600


def test_a_closed_flight_that_says_no_seconds_is_not_told_of_them(written) -> None:
    stops = [dict(stop, time=1000 * time) for time, stop in enumerate(LOOKING["stops"])]
    with pytest.raises(SceneError, match=r"json: takes 4000 seconds; give up to 3600"):
        read(written(change(stops=stops, closed=True)))


def test_times_and_seconds_of_an_open_flight_are_refused(written) -> None:
    stops = [dict(stop, time=time) for time, stop in enumerate(LOOKING["stops"])]
    with pytest.raises(SceneError, match="leave one out"):
        read(written(change(stops=stops, seconds=9)))


@pytest.mark.parametrize("times", [(0, 2, 2, 3), (-1000, 1e-20, 2e-20, 1), (0, 1e-320, 1, 2)])
def test_times_must_rise(times: tuple[float, ...], written) -> None:
    stops = [dict(stop, time=time) for stop, time in zip(LOOKING["stops"], times, strict=True)]
    with pytest.raises(SceneError, match="do not rise"):
        read(written(change(stops=stops)))


def test_straight_down_is_refused_where_the_roll_is_open(written) -> None:
    flight = read(written(change(stops=[{"position": [0, 0, 4], "look_at": [0, 0, 0]}])))
    with pytest.raises(SceneError, match="straight up or down"):
        flown(flight, np.array([0.0]))


def test_what_nothing_says_is_asked_for(written) -> None:
    bare = {key: value for key, value in LOOKING.items() if key not in ("fov", "width")}
    for document, words in ((bare, "width"), (bare | {"width": 9}, "fov"), (LOOKING, "up")):
        with pytest.raises(SceneError, match=words):
            read_key_frames(written(document), None, None)


@pytest.mark.parametrize("closed", [False, True])
@pytest.mark.parametrize("looks", [False, True])
def test_what_is_written_flies_the_same(written, tmp_path: Path, closed: bool, looks: bool) -> None:
    stops = LOOKING["stops"]
    if not looks:
        stops = [*stops[:3], {"camera_to_world": matrix_of(camera_at(torch.tensor([0.5, 1, 1]), torch.zeros(3)))}]
    first = read(written(LOOKING | {"stops": stops, "closed": closed, "seconds": 5, "up": [0, 0.1, 2], "fps": 24}))
    write_key_frames(tmp_path / "again.json", first)
    again = read_key_frames(tmp_path / "again.json", None, None if not looks else UP)
    assert (again.seconds, again.closed, again.fps) == (first.seconds, closed, 24)
    times = frame_times(first, None, 24.0, 1000)
    assert (times == frame_times(again, None, 24.0, 1000)).all()
    for one, other in zip(flown(first, times), flown(again, times), strict=True):
        torch.testing.assert_close(one.world_to_camera, other.world_to_camera, atol=1e-6, rtol=0)
        assert other.focal == pytest.approx(one.focal, rel=1e-9)
        assert (one.width, one.height) == (other.width, other.height)


def test_which_files_are_ours(written) -> None:
    assert holds_key_frames(written(LOOKING))
    assert not holds_key_frames(written({"camera_path": []}))


def test_the_documents_example_flies(written) -> None:
    text = (Path(__file__).parents[2] / "docs" / "render.md").read_text(encoding="utf-8")
    flight = read(written(json.loads(text.partition("```json")[2].partition("```")[0])))
    assert len(flight.stops) == 3
    assert_rigid(flown(flight, frame_times(flight, None, flight.fps, 1000)))
