"""Bytes as text: what comes back is what went in, and no parser of HTML changes the text on its way."""

from html.parser import HTMLParser

import numpy as np
import pytest
from hypothesis import example, given
from hypothesis import strategies as st

from ringlight.files.page.text_bytes import bytes_from_text, text_from_bytes


@given(st.binary(max_size=300))
@example(b"")
@example(bytes(100))
@example(bytes([0x1A, 0x34, 0x68]) * 40)
def test_bytes_come_back(data: bytes) -> None:
    assert bytes_from_text(text_from_bytes(data), len(data)) == data


@given(st.binary(max_size=300))
def test_the_text_is_safe_in_a_script_element(data: bytes) -> None:
    text = text_from_bytes(data)
    assert not set(text) & {"\0", "\r", "<"}
    assert text.encode().decode() == text
    assert all(character < "\x80" or character >= "\u0100" for character in text)


def test_it_takes_an_eighth_more_than_random_bytes() -> None:
    data = np.random.default_rng(0).bytes(100_000)
    assert len(text_from_bytes(data).encode()) / len(data) < 8 / 7 * 1.01


def test_a_parser_of_html_reads_the_same_bytes() -> None:
    data = np.random.default_rng(1).bytes(5_000)
    found: list[str] = []

    class Reader(HTMLParser):
        def handle_data(self, text: str) -> None:
            found.append(text)

    reader = Reader()
    reader.feed(f'<script type="text/plain">{text_from_bytes(data)}</script>')
    reader.close()
    assert bytes_from_text("".join(found), len(data)) == data


@pytest.mark.parametrize("text", ["<", "\u0080", "\uffff", "ab"])
def test_other_text_is_refused(text: str) -> None:
    with pytest.raises(ValueError, match="bytes"):
        bytes_from_text(text, 100)
