"""The page itself: its source, the model's facts and numbers, and a still picture, in one HTML file.

Nothing in it comes from another place, and its policy (Content Security Policy, level 3) says so to the browser: two
scripts and one style sheet, by their hashes, a worker made of a text in the payload, and the still as data. What a
model brings, names and numbers, is JSON or text in elements that are not run, with no "<" in it.
"""

import base64
import html
import json
from functools import cache
from pathlib import Path
from string import Template
from typing import Any

from ringlight.files.page.modules import joined, slim
from ringlight.files.page.text_bytes import text_from_bytes
from ringlight.files.page_policy import page_policy

SOURCE = Path(__file__).parent / "source"
"""The page's own files."""

STYLES = ("style.css", "panel.css")
"""One style sheet, in this order."""

STRICT = '"use strict";\n'


def page_of(title: str, facts: dict[str, Any], payload: bytes, still: bytes) -> bytes:
    """The HTML file. ``facts`` are JSON values; ``payload`` holds :func:`program_texts`; ``still`` is a JPEG."""
    script, style = _script(), slim("".join(_sources()[name] for name in STYLES))
    text = Template(_sources()["page.html"]).substitute(
        policy=page_policy([script, program_texts()["main.js"]], style, workers=True),
        title=html.escape(title),
        style=style,
        still="data:image/jpeg;base64," + base64.b64encode(still).decode("ascii"),
        facts=_json(facts),
        length=len(payload),
        payload=text_from_bytes(payload),
        script=script,
    )
    return text.encode(errors="replace")  # a folder's name may be no text


def _json(value: object) -> str:
    """JSON in ASCII that ends no element and begins no comment; refuses NaN and infinities."""
    text = json.dumps(value, separators=(",", ":"), allow_nan=False)
    return text.replace("<", "\\u003c").replace(">", "\\u003e").replace("&", "\\u0026")


@cache
def _sources() -> dict[str, str]:
    return {entry.name: entry.read_text("utf-8") for entry in sorted(SOURCE.iterdir()) if entry.is_file()}


@cache
def _modules() -> dict[str, str]:
    return {name: text for name, text in _sources().items() if name.endswith(".js")}


@cache
def _script() -> str:
    """What the browser runs first; the rest of the program comes out of the payload."""
    return _program("boot.js")


def _program(first: str) -> str:
    return f"(() => {{\n{STRICT}{joined(_modules(), first)}\n}})();"


@cache
def program_texts() -> dict[str, str]:
    """For the payload, where they are deflated: the page's program, the worker's, and the shaders by file name."""
    shaders = {name: slim(text) for name, text in sorted(_sources().items()) if name.endswith(".glsl")}
    return shaders | {"main.js": _program("main.js"), "worker.js": _program("lists_worker.js")}
