"""Write kernels' convention.hpp from Python modules of numbers, so that each shared number exists once.

python write_convention.py SOURCE... TARGET
"""

import ast
import sys
from pathlib import Path


def constants(source: str) -> dict[str, int | float]:
    """The module's upper-case assignments; only arithmetic on literals is evaluated."""
    values: dict[str, int | float] = {}
    for node in ast.parse(source).body:
        if isinstance(node, ast.Assign) and isinstance(node.targets[0], ast.Name) and node.targets[0].id.isupper():
            values[node.targets[0].id] = eval(compile(ast.Expression(node.value), "convention", "eval"), {}, {})
    return values


def header(values: dict[str, int | float], names: list[str]) -> str:
    lines = [f"// Generated from {', '.join(names)}; edit these files.", "#pragma once"]
    lines.append("namespace ringlight::convention {")
    for name, value in values.items():
        kind, literal = ("int", str(value)) if isinstance(value, int) else ("float", f"{value!r}f")
        lines.append(f"inline constexpr {kind} {name} = {literal};")
    return "\n".join([*lines, "}", ""])


*sources, target = map(Path, sys.argv[1:])
values = {name: value for source in sources for name, value in constants(source.read_text()).items()}
target.parent.mkdir(parents=True, exist_ok=True)
target.write_text(header(values, [source.name for source in sources]))
