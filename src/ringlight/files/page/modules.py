"""The page's JavaScript modules joined into one script, without a tool that users would have to install.

Each module becomes a function that is called once and returns what the module exports, so that no two share a name that
they do not mean to. Only what our own modules use is understood: ``import { a, b } from "./file.js"`` on one line, and
``export`` before a function, an async function, a class or a constant.
"""

import re
from collections.abc import Mapping

IMPORT = re.compile(r'^import \{ (?P<names>[^}]+) \} from "\./(?P<file>[\w.]+)";$', re.MULTILINE)
EXPORT = re.compile(r"^export (?=(?:async function|function|class|const) (?P<name>\w+))", re.MULTILINE)


def joined(sources: Mapping[str, str], first: str) -> str:
    """The code of the module ``first`` and all that it imports, each once, after what it imports itself.

    ``sources`` are the modules' texts by file name. Raises ValueError for modules that import each other in a circle or
    import what is not exported, and for a form of import or export that is not understood.
    """
    order = _in_order(sources, first)
    return "\n".join(_wrapped(name, sources) for name in order)


def _in_order(sources: Mapping[str, str], first: str) -> list[str]:
    done: list[str] = []
    under_way: list[str] = []

    def visit(name: str) -> None:
        if name in done:
            return
        if name in under_way:
            raise ValueError(f"modules import each other in a circle: {' -> '.join([*under_way, name])}")
        under_way.append(name)
        for found in IMPORT.finditer(sources[name]):
            visit(found["file"])
        done.append(under_way.pop())

    visit(first)
    return done


def _wrapped(name: str, sources: Mapping[str, str]) -> str:
    text = sources[name]
    for found in IMPORT.finditer(text):
        wanted = {word.strip() for word in found["names"].split(",")}
        missing = wanted - _exports(sources[found["file"]])
        if missing:
            raise ValueError(f"{name} imports {sorted(missing)[0]}, which {found['file']} does not export")
    code = IMPORT.sub(lambda found: f"const {{ {found['names']} }} = {_variable(found['file'])};", text)
    code = EXPORT.sub("", code)
    if re.search(r"^(import|export)\b", code, re.MULTILINE):
        raise ValueError(f"{name} has an import or export of a form that is not understood")
    returned = ", ".join(sorted(_exports(text)))
    return f"const {_variable(name)} = (() => {{\n{slim(code)}\nreturn {{ {returned} }};\n}})();"


def _exports(text: str) -> set[str]:
    return {found["name"] for found in EXPORT.finditer(text)}


def _variable(file: str) -> str:
    return "$" + file.removesuffix(".js")


def slim(code: str) -> str:
    """JavaScript or GLSL without lines that are comments alone, without indentation and empty lines."""
    lines = (line.strip() for line in code.splitlines())
    return "\n".join(line for line in lines if line and not line.startswith("//"))
