"""The line of facts: what matters most stays where there is little room."""

import pytest

from ringlight.cli.progress import fitting

FACTS = ["  50.0 it/s", "training 20.25 dB", "12,345 Gaussians", "2.91 MB"]


@pytest.mark.parametrize(
    ("room", "kept"),
    [(None, 4), (200, 4), (75, 4), (74, 3), (66, 3), (65, 2), (48, 2), (47, 1), (29, 1), (28, 0), (3, 0)],
)
def test_the_time_that_is_left_goes_last(room: int | None, kept: int):
    line = fitting(FACTS, "about 3 min left", room)
    assert line == "  ".join([*FACTS[:kept], "about 3 min left"])
    assert room is None or not kept or len(line) <= room
