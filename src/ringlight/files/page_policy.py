"""What a page of ours lets a browser do: nothing but what stands in it (Content Security Policy, level 3)."""

import base64
import hashlib
from collections.abc import Sequence


def page_policy(scripts: Sequence[str], style: str, workers: bool = False) -> str:
    """For a page that loads nothing: it shows pictures of its own, and runs these scripts alone, known by their hashes,
    so that what a hostile name might smuggle in does not run. With ``workers`` it may make some of its own texts."""
    rules = {
        "default-src": "'none'",
        "script-src": " ".join(map(_hash, scripts)),
        "style-src": _hash(style),
        "img-src": "data:",
        "base-uri": "'none'",
        "form-action": "'none'",
    }
    if workers:
        rules["worker-src"] = "blob:"
    return "; ".join(f"{name} {value}" for name, value in rules.items())


def _hash(text: str) -> str:
    digest = hashlib.sha256(text.encode()).digest()
    return f"'sha256-{base64.b64encode(digest).decode('ascii')}'"
