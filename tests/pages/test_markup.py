"""Whatever a name holds, it is text on the page."""

import pytest
from hypothesis import given
from hypothesis import strategies as st
from parsed import Parsed

from ringlight.core.visible_text import visible
from ringlight.pages.markup import Html, element, joined, name

HOSTILE = [
    "</script><script>alert(1)</script>",
    "<img src=x onerror=alert(1)>",
    "\"quotes\" and 'others' & &amp;",
    "\u202egnp.exe",
    "a\u2066b\u200bc",
    "nul\x00 bell\x07 escape\x1b[31m",
    "byte \udcff that is no text",
    "two\nlines\u2028three",
    "{{script}}",
]


@given(st.text())
def test_texts_and_attributes_come_back_as_they_were(text: str) -> None:
    page = Parsed(element("p", text, title=text, class_="x"))
    assert "".join(page.texts) == visible(text)
    assert page.elements == [("p", {"title": visible(text), "class": "x"})]


@pytest.mark.parametrize("text", HOSTILE)
def test_hostile_names_are_text(text: str) -> None:
    page = Parsed(name(text))
    assert [tag for tag, _ in page.elements] == ["bdi"]
    shown = "".join(page.texts)
    shown.encode()
    assert not any(mark in shown for mark in "\u202e\u2066\u200b\x00\x07\x1b\n\u2028")


def test_what_hides_is_an_escape_and_other_scripts_stay() -> None:
    assert visible("a\u202eb") == "a\\u202eb"
    assert visible("\u3164\u2800") == "\\u3164\\u2800", "letters and signs that are blank"
    assert visible("צילום 写真 é ☃") == "צילום 写真 é ☃"


def test_attributes() -> None:
    assert element("input", type="radio", checked=True, disabled=False, data_key="k", title=None) == (
        '<input type="radio" checked data-key="k">'
    )
    assert element("label", "x", for_="a") == '<label for="a">x</label>'


def test_html_is_not_escaped_twice() -> None:
    inner = element("b", "<")
    assert element("p", inner, joined([inner, Html("&amp;")])) == "<p><b>&lt;</b><b>&lt;</b>&amp;</p>"
