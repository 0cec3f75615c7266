"""The picture of cameras and points: everything lies where it should."""

import numpy as np

from ringlight.poses.picture import MARGIN, ROOM, SIDE, TEXT, Found, draw_cameras


def pixel(view: int, across: float, up: float, half: float) -> tuple[int, int]:
    left, top = MARGIN + view * (SIDE + MARGIN), MARGIN + 2 * TEXT
    return round(left + (across / half + 1) * SIDE / 2), round(top + (1 - up / half) * SIDE / 2)


def test_cameras_and_points_lie_where_they_are():
    centers = np.array([[-2.0, 0.0, 1.0], [2.0, -1.0, 1.0]])
    points = np.array([[0.5, 0.5, 0.25], [-0.5, -0.5, -0.25], [0.0, 0.0, 0.0]])
    colors = np.array([[1.0, 0.0, 1.0], [0.0, 1.0, 1.0], [0.0, 1.0, 0.0]])
    found = Found(centers, np.array([[1.0, 0, 0], [-1.0, 0, 0]]), points, colors)
    picture = np.asarray(draw_cameras(found, "two cameras"))
    half = ROOM * 2.0

    def around(view: int, across: float, up: float) -> set[tuple[int, ...]]:
        x, y = pixel(view, across, up, half)
        return {tuple(color) for color in picture[y - 1 : y + 2, x - 1 : x + 2].reshape(-1, 3)}

    assert (255, 0, 255) in around(0, 0.5, 0.5)
    assert (255, 0, 255) in around(1, 0.5, 0.25)
    assert (0, 255, 255) in around(0, -0.5, -0.5)
    assert (0xD1, 0x49, 0x5B) in around(0, -2.0, 0.0), "the first camera is red"
    assert (0x0B, 0x5F, 0xA5) in around(1, 2.0, 1.0)


def test_a_model_without_points_and_one_camera_is_drawn():
    nothing = np.zeros((0, 3))
    picture = draw_cameras(Found(np.zeros((1, 3)), np.array([[0.0, 0, 1]]), nothing, nothing), "")
    assert picture.width > 2 * SIDE
