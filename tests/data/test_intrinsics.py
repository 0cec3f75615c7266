"""A pinhole in the pixels of the image at hand: resized ones fit, cropped and stretched ones are refused."""

import pytest
from hypothesis import given
from hypothesis import strategies as st

from ringlight.data.intrinsics import MOST_RESIZED, Intrinsics, checked_intrinsics
from ringlight.errors import SceneError

SIDES = st.integers(16, 5000)


def pinhole(width: int, height: int) -> Intrinsics:
    return Intrinsics((1.2 * width, 1.2 * width), (width / 2, height / 2), width, height)


@given(
    width=SIDES,
    height=SIDES,
    factor=st.integers(1, 16),
    up=st.tuples(st.booleans(), st.booleans()),
    enlarged=st.booleans(),
)
def test_an_image_resized_with_any_rounding_fits(
    width: int, height: int, factor: int, up: tuple[bool, bool], enlarged: bool
):
    small = tuple(
        -(-side // factor) if above else side // factor for side, above in zip((width, height), up, strict=True)
    )
    if (small[0] - small[1]) * (width - height) < 0:
        return
    image, camera = ((width, height), small) if enlarged else (small, (width, height))
    fitted = pinhole(*camera).on_image(*image, "frame 3")
    assert (fitted.width, fitted.height) == image
    assert fitted.center == pytest.approx((image[0] / 2, image[1] / 2))


@given(width=st.integers(60, 4000), height=st.integers(60, 4000), cut=st.floats(0.1, 0.6), of_width=st.booleans())
def test_an_image_that_was_cropped_or_stretched_is_refused_with_both_shapes(
    width: int, height: int, cut: float, of_width: bool
):
    image = (round(width * (1 - cut)), height) if of_width else (width, round(height * (1 - cut)))
    with pytest.raises(SceneError, match=f"frame 3 has an image of {image[0]}x{image[1]} .* {width}x{height}"):
        pinhole(width, height).on_image(*image, "frame 3")


@pytest.mark.parametrize("image", [(1, 1), (244, 1), (1, 135), (244 * MOST_RESIZED * 2, 135 * MOST_RESIZED * 2)])
def test_a_thumbnail_or_placeholder_is_refused(image: tuple[int, int]):
    with pytest.raises(SceneError, match="244x135"):
        pinhole(244, 135).on_image(*image, "frame 3")


def test_a_size_that_cannot_be_is_told_in_english():
    with pytest.raises(SceneError, match="frame 3 has an image size of 0 pixels"):
        checked_intrinsics((20.0, 20.0), (8.0, 6.0), (0.0, 12.0), "frame 3")
