"""Names on contact sheets can be read whatever script they are in, and nothing is cut at a narrow sheet's edge."""

import pytest
from hypothesis import given
from hypothesis import strategies as st
from PIL import ImageFont

from ringlight.measure.sheet_text import drawable, wrapped


@pytest.mark.parametrize(
    ("text", "shown"),
    [
        ("r_0.png", "r_0.png"),
        ("Küche", "Kuche"),
        ("Garten №3", "Garten No3"),
        ("写真", r"\u5199\u771f"),
        ("a\x1b[2J", r"a\x1b[2J"),
        ("½ ﬁn", r"\xbd fin"),
    ],
)
def test_every_letter_is_one_that_the_font_has(text: str, shown: str):
    assert drawable(text) == shown


@given(st.text())
def test_what_is_drawn_is_printable_ascii(text: str):
    shown = drawable(text)
    assert shown.isascii()
    assert shown.isprintable()
    assert bool(shown) or not text


@given(st.lists(st.text("abcxyz", min_size=1, max_size=8), min_size=1, max_size=12), st.integers(60, 300))
def test_lines_fit_and_no_word_is_lost(words: list[str], width: int):
    lines = wrapped(" ".join(words), 13, width)
    assert " ".join(lines).split() == words
    font = ImageFont.load_default(13)
    assert all(font.getlength(line) <= width or " " not in line for line in lines)
