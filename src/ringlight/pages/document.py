"""One file of a page's sources: template, style and script lie readable in the package and are joined here.

The browser is told, by a Content-Security-Policy, to load nothing and to run this script alone, which it knows by its
hash: what a hostile name might smuggle in would not run.
"""

import re
from importlib import resources
from importlib.resources.abc import Traversable

from ringlight.files.page_policy import page_policy
from ringlight.pages.markup import Html, html_of

PLACE = re.compile(r"\{\{(\w+)\}\}")


def document(folder: str, title: str, body: Html) -> str:
    """The page of the template, style and script in a package ``folder``: page.html, page.css, page.js."""
    sources = resources.files(folder)
    style, script = _source(sources / "page.css", "</style"), _source(sources / "page.js", "</script")
    parts = {
        "policy": page_policy([script], style),
        "title": html_of(title),
        "style": style,
        "script": script,
        "body": body,
    }
    # In one pass: what stands in a part is never taken for a place.
    return PLACE.sub(lambda place: parts[place[1]], (sources / "page.html").read_text(encoding="utf-8"))


def _source(file: Traversable, end: str) -> str:
    text = file.read_text(encoding="utf-8")
    if end in text.lower():
        raise ValueError(f"{file.name} holds {end!r}, which would end it")
    return text
