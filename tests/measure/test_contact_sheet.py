"""The contact sheet: what must be on it, and where; not pixel by pixel."""

import numpy as np
import pytest
import torch
from PIL import Image
from samples import picture

from ringlight.errors import RunError
from ringlight.measure.contact_sheet import MARK, SheetColumn, contact_sheet
from ringlight.measure.sheet_layout import GAP, MARGIN, MAX_WIDTH
from shared_data import shared

SIZE = 200
MARK_COLOR = tuple(bytes.fromhex(MARK[1:]))


def grey(value=0.5, height=SIZE, width=SIZE):
    return torch.full((height, width, 3), value)


def with_spot(value):
    """Grey with a bright square at rows 120 to 140, columns 40 to 60."""
    image = grey()
    image[120:140, 40:60] = value
    return image


@pytest.fixture
def sheet():
    truth = {"r_1": grey(), "r_2": grey()}
    good = SheetColumn("good", {"r_1": grey(), "r_2": grey()})
    bad = SheetColumn("bad", {"r_1": grey(), "r_2": with_spot(1.0)})
    return contact_sheet([good, bad], truth, views=1)


def columns_of_mark(sheet):
    pixels = np.asarray(sheet)
    return (pixels == MARK_COLOR).all(-1)


def test_columns_stand_side_by_side_on_white(sheet):
    pixels = np.asarray(sheet)
    assert sheet.width == 2 * MARGIN + 3 * 400 + 2 * GAP
    assert (pixels[: MARGIN // 2] == 255).all()
    assert (pixels[:, : MARGIN // 2] == 255).all()
    assert (pixels[-MARGIN // 2 :] == 255).all()


def test_the_box_is_drawn_around_the_difference_in_every_column(sheet):
    marked = columns_of_mark(sheet)
    for index in range(3):
        left = MARGIN + index * (400 + GAP)
        # Upright lines of the box: the full view is 400 pixels high, the enlarged box below has its own frame.
        view = marked[: MARGIN + 400, left : left + 400]
        rows, columns = np.nonzero(view)
        assert len(rows) > 0
        # Twice the size: the spot is at columns 80 to 120 of the view.
        assert columns.min() <= 80
        assert columns.max() >= 119


def test_the_enlarged_box_shows_the_spot_and_the_error_map_lights_up(sheet):
    pixels = np.asarray(sheet).astype(int)
    half = pixels[-300:, :, :]
    third = half[:, MARGIN + 2 * (400 + GAP) :]
    second = half[:, MARGIN + 400 + GAP : MARGIN + 2 * 400 + GAP]
    enlarged_white = (third[:, 10:180] == 255).all(-1).sum()
    assert enlarged_white > 20 * 20 * 4
    brightest_error = third[:, 210:390].sum(-1)
    good_error = second[:, 210:390].sum(-1)
    dark = 60
    # Black is no error: all of the good map, only part of the bad one.
    assert (good_error < dark).sum() > (brightest_error < dark).sum() > 0


def test_the_same_input_gives_the_same_sheet():
    truth = {name: picture(40, 60, seed) for seed, name in enumerate("abcd")}
    columns = [SheetColumn(str(k), {n: picture(40, 60, 10 * k + s) for s, n in enumerate("abcd")}) for k in (1, 2)]
    one, two = contact_sheet(columns, truth), contact_sheet(columns, truth)
    assert one.tobytes() == two.tobytes()


@pytest.mark.parametrize(("height", "width", "count"), [(541, 976, 4), (800, 800, 7), (33, 21, 1), (300, 100, 2)])
def test_any_size_fits(height, width, count):
    truth = {"view": picture(height, width)}
    columns = [SheetColumn("a name that is too long for a narrow column" * 3, truth) for _ in range(count)]
    assert contact_sheet(columns, truth, title="a scene").width <= MAX_WIDTH


def test_more_views_make_it_longer_and_never_more_than_there_are():
    truth = {name: picture(40, 60) for name in "ab"}
    heights = [contact_sheet([SheetColumn("m", truth)], truth, views=count).height for count in (1, 2, 3)]
    assert heights[0] < heights[1] == heights[2]


def test_identical_and_undefined_renders_are_drawn():
    truth = {"view": picture()}
    broken = SheetColumn("broken", {"view": torch.full_like(truth["view"], float("nan"))})
    assert contact_sheet([SheetColumn("same", truth), broken], truth).height > 0


def test_views_of_different_size_share_a_sheet():
    truth = {"wide": picture(50, 90), "tall": picture(90, 50)}
    assert contact_sheet([SheetColumn("m", truth)], truth).width <= MAX_WIDTH


def test_nothing_to_show_is_refused():
    with pytest.raises(RunError, match="at least one run"):
        contact_sheet([], {"a": picture()})
    with pytest.raises(RunError, match="no test picture in common"):
        contact_sheet([SheetColumn("m", {})], {"a": picture()})


def test_a_real_scene_gives_a_readable_sheet():
    folder = shared("data/bundle/toaster_200/test")
    truth = {}
    for path in sorted(folder.glob("*.png"))[:3]:
        values = torch.from_numpy(np.array(Image.open(path).convert("RGBA"))).float() / 255
        truth[path.stem] = torch.lerp(torch.ones(3), values[..., :3], values[..., 3:])
    rough = {name: image[::4, ::4].repeat_interleave(4, 0).repeat_interleave(4, 1) for name, image in truth.items()}
    sheet = contact_sheet([SheetColumn("rough", rough), SheetColumn("same", truth)], truth, title="toaster_200")
    assert sheet.width == 2 * MARGIN + 3 * 400 + 2 * GAP
    assert columns_of_mark(sheet).any()
