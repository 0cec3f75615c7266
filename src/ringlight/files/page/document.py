"""The page itself: its source, the model's facts and numbers, and a still picture, in one HTML file.

Nothing in it comes from another place, and its policy (Content Security Policy, level 3) says so to the browser: one
script and one style sheet, by their hashes, a worker made of text that the script holds, and the still as data. What a
model brings, names and numbers, is JSON or text in elements that are not run, with no "<" in it.
"""

import base64
import hashlib
import html
import json
from functools import cache
from importlib.resources import files
from string import Template
from typing import Any

from ringlight.files.page.modules import joined, slim
from ringlight.files.page.text_bytes import text_from_bytes

SOURCE = "source"
"""Folder beside this file."""

STRICT = '"use strict";\n'


def page_of(title: str, facts: dict[str, Any], payload: bytes, still: bytes) -> bytes:
    """The HTML file. ``facts`` are JSON values; ``still`` is a JPEG."""
    script, style = _script(), slim(_sources()["style.css"])
    text = Template(_sources()["page.html"]).substitute(
        policy=_policy(script, style),
        title=html.escape(title),
        style=style,
        still="data:image/jpeg;base64," + base64.b64encode(still).decode("ascii"),
        facts=_json(facts),
        length=len(payload),
        payload=text_from_bytes(payload),
        script=script,
    )
    return text.encode()


def _policy(script: str, style: str) -> str:
    rules = {
        "default-src": "'none'",
        "script-src": _hash(script),
        "style-src": _hash(style),
        "worker-src": "blob:",
        "img-src": "data:",
        "base-uri": "'none'",
        "form-action": "'none'",
    }
    return "; ".join(f"{name} {value}" for name, value in rules.items())


def _hash(text: str) -> str:
    digest = hashlib.sha256(text.encode()).digest()
    return f"'sha256-{base64.b64encode(digest).decode('ascii')}'"


def _json(value: object) -> str:
    """JSON in ASCII that ends no element and begins no comment; refuses NaN and infinities."""
    text = json.dumps(value, separators=(",", ":"), allow_nan=False)
    return text.replace("<", "\\u003c").replace(">", "\\u003e").replace("&", "\\u0026")


@cache
def _sources() -> dict[str, str]:
    folder = files(__package__).joinpath(SOURCE)
    return {entry.name: entry.read_text("utf-8") for entry in folder.iterdir()}


@cache
def _script() -> str:
    """The page's whole script, with the worker's and the shaders as texts in it."""
    sources = _sources()
    modules = {name: text for name, text in sources.items() if name.endswith(".js")}
    shaders = {name: slim(text) for name, text in sorted(sources.items()) if name.endswith(".glsl")}
    worker = f"{STRICT}{joined(modules, 'lists_worker.js')}"
    constants = f"const shaders = {_json(shaders)}, workerSource = {_json(worker)};\n"
    return f"(() => {{\n{STRICT}{constants}{joined(modules, 'main.js')}\n}})();"
