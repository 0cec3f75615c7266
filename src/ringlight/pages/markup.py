"""HTML from texts that strangers wrote: every text is escaped, and what could turn or hide text can be read."""

from html import escape

from ringlight.core.visible_text import visible

EMPTY = {"meta", "img", "input", "br"}
"""HTML's elements without an end; those of SVG have one."""


class Html(str):
    """Text that is HTML already; a plain string is not, and gets escaped."""

    __slots__ = ()


def html_of(part: str) -> Html:
    """The part as HTML: itself, or escaped."""
    return part if isinstance(part, Html) else Html(escape(visible(part)))


def element(tag: str, *children: str, **attributes: str | int | float | bool | None) -> Html:
    """One element. ``class_`` and ``for_`` lose their underscore, others in a name become hyphens; None and False leave
    an attribute out, True gives it no value."""
    words = [tag]
    for name, value in attributes.items():
        if value is None or value is False:
            continue
        key = name.rstrip("_").replace("_", "-")
        text = f"{value:g}" if isinstance(value, float) else str(value)
        words.append(key if value is True else f'{key}="{escape(visible(text))}"')
    inside = "".join(map(html_of, children))
    return Html(f"<{' '.join(words)}>" + ("" if tag in EMPTY else f"{inside}</{tag}>"))


def name(text: str, **attributes: str | None) -> Html:
    """A name that may be in any script, which decides nothing about the direction of what is around it."""
    return element("bdi", text, **attributes)


def joined(parts: "list[Html] | tuple[Html, ...]") -> Html:
    """One after the other."""
    return Html("".join(parts))
