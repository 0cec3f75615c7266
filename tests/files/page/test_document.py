"""The file: nothing from elsewhere, one script by its hash, and names of a model that cannot become markup."""

import base64
import hashlib
import json
import re
from html.parser import HTMLParser

import pytest

from ringlight.files.page.document import page_of, program_texts

HOSTILE = "</script><script>alert(1)</script><!-- \"quoted\" 'too' &amp; \u202egnp.exe\u2028"


class Outline(HTMLParser):
    """Elements with their attributes, and the text of each."""

    def __init__(self, page: bytes):
        super().__init__()
        self.found: list[tuple[str, dict[str, str | None]]] = []
        self.texts: list[str] = []
        self.feed(page.decode())
        self.close()

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.found.append((tag, dict(attrs)))
        self.texts.append("")

    def handle_data(self, data: str) -> None:
        if self.texts:
            self.texts[-1] += data

    def handle_endtag(self, tag: str) -> None:
        self.found.append(("", {}))
        self.texts.append("")

    def texts_of(self, tag: str, **attributes: str) -> list[str]:
        pairs = zip(self.found, self.texts, strict=True)
        return [text for (name, has), text in pairs if name == tag and attributes.items() <= has.items()]


@pytest.fixture(scope="module")
def page() -> bytes:
    return page_of(HOSTILE, {"caption": {"scene": HOSTILE}}, b"\x00\x3c\r" * 50, b"\xff\xd8still")


def test_hostile_names_stay_text(page: bytes) -> None:
    outline = Outline(page)
    assert outline.texts_of("title") == [HOSTILE]
    assert json.loads(outline.texts_of("script", id="facts")[0])["caption"]["scene"] == HOSTILE
    assert len(outline.texts_of("script")) == 3
    assert b"alert(1)</script>" not in page


def test_the_policy_allows_this_script_and_this_style_alone(page: bytes) -> None:
    outline = Outline(page)
    [policy] = [has["content"] for tag, has in outline.found if has.get("http-equiv") == "Content-Security-Policy"]
    rules = dict(rule.split(" ", 1) for rule in str(policy).split("; "))
    assert rules["default-src"] == "'none'"
    assert rules["worker-src"] == "blob:"
    assert "unsafe" not in str(policy)
    assert not re.search(r"https?:|\*", str(policy))
    scripts = [outline.texts_of("script")[-1], program_texts()["main.js"]]
    assert rules["script-src"] == " ".join(map(hashed, scripts))
    assert rules["style-src"] == hashed(outline.texts_of("style")[0])


def hashed(text: str) -> str:
    return f"'sha256-{base64.b64encode(hashlib.sha256(text.encode()).digest()).decode()}'"


def test_nothing_comes_from_elsewhere(page: bytes) -> None:
    places = [has[name] for _, has in Outline(page).found for name in ("src", "href", "action") if name in has]
    assert len(places) == 1
    assert str(places[0]).startswith("data:image/jpeg;base64,")
    assert not re.search(rb"https?://", page)
    program = page.decode() + "".join(program_texts().values())
    assert not re.search(r"\binnerHTML|outerHTML|insertAdjacent|document\.write|\beval\(|new Function|fetch\(", program)


def test_the_program_is_small(page: bytes) -> None:
    assert len(page) < 20_000


def test_a_number_that_json_has_not_is_refused() -> None:
    with pytest.raises(ValueError, match="not JSON compliant"):
        page_of("a", {"psnr": float("inf")}, b"", b"")
