"""A page as Python's own HTML parser sees it: the judge of what we write."""

import base64
import hashlib
from html.parser import HTMLParser

ENDLESS = {"meta", "img", "input", "br"}


class Parsed(HTMLParser):
    """Elements in order with their attributes, the texts outside of style and script, and these two."""

    def __init__(self, page: str):
        super().__init__(convert_charrefs=True)
        self.elements: list[tuple[str, dict[str, str | None]]] = []
        self.texts: list[str] = []
        self.sources: dict[str, list[str]] = {"style": [], "script": []}
        self._open: list[str] = []
        self.feed(page)
        self.close()
        assert not self._open, f"never closed: {self._open}"

    def handle_starttag(self, tag: str, attributes: list[tuple[str, str | None]]) -> None:
        names = [name for name, _ in attributes]
        assert len(set(names)) == len(names), f"<{tag}> says something twice: {names}"
        self.elements.append((tag, dict(attributes)))
        if tag not in ENDLESS:
            self._open.append(tag)
            if tag in self.sources:
                self.sources[tag].append("")

    def handle_endtag(self, tag: str) -> None:
        assert self._open, f"</{tag}> closes nothing"
        assert self._open.pop() == tag

    def handle_data(self, data: str) -> None:
        if self._open and self._open[-1] in self.sources:
            self.sources[self._open[-1]][-1] += data
        else:
            self.texts.append(data)

    def all(self, tag: str) -> list[dict[str, str | None]]:
        return [attributes for name, attributes in self.elements if name == tag]

    @property
    def text(self) -> str:
        return " ".join(self.texts)


def assert_loads_nothing(page: Parsed) -> None:
    """No address but data and places in the page; no script but the one whose hash the policy names."""
    for tag, attributes in page.elements:
        for name, value in attributes.items():
            assert not name.startswith("on"), f"<{tag} {name}>"
            assert name != "style", f"<{tag}> has a style of its own, which the policy forbids"
            if name in ("src", "href", "action", "data", "poster", "srcset"):
                assert (value or "").startswith(("data:image/", "#")), f"<{tag} {name}={value!r}>"
    policy = next(a["content"] or "" for a in page.all("meta") if a.get("http-equiv") == "Content-Security-Policy")
    rules = {rule.split()[0]: rule.split()[1:] for rule in policy.split("; ")}
    assert rules["default-src"] == ["'none'"]
    assert rules["img-src"] == ["data:"]
    for kind in ("style", "script"):
        [source] = page.sources[kind]
        digest = base64.b64encode(hashlib.sha256(source.encode()).digest()).decode()
        assert rules[f"{kind}-src"] == [f"'sha256-{digest}'"]
    assert not {"iframe", "object", "embed", "link", "base", "form"} & {tag for tag, _ in page.elements}
