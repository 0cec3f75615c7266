"""Write kernels' convention.hpp from Python modules of numbers, so that each shared number exists once.

python write_convention.py SOURCE... TARGET
"""

import ast
import sys
from math import pi, sqrt
from pathlib import Path

Value = int | float | tuple[float, ...]


def constants(source: str) -> dict[str, Value]:
    """The module's upper-case assignments of numbers; only arithmetic on literals is evaluated."""
    values: dict[str, Value] = {}
    for node in ast.parse(source).body:
        if isinstance(node, ast.Assign) and isinstance(node.targets[0], ast.Name) and node.targets[0].id.isupper():
            known = {"__builtins__": {}, "pi": pi, "sqrt": sqrt}
            values[node.targets[0].id] = eval(compile(ast.Expression(node.value), "convention", "eval"), known)
    return values


def definition(name: str, value: Value) -> str:
    if isinstance(value, tuple):
        return f"inline constexpr float {name}[] = {{{', '.join(f'{float(number)!r}f' for number in value)}}};"
    kind, literal = ("int", str(value)) if isinstance(value, int) else ("float", f"{value!r}f")
    return f"inline constexpr {kind} {name} = {literal};"


def header(values: dict[str, Value], names: list[str]) -> str:
    lines = [f"// Generated from {', '.join(names)}; edit these files.", "#pragma once"]
    lines.append("namespace ringlight::convention {")
    lines += [definition(name, value) for name, value in values.items()]
    return "\n".join([*lines, "}", ""])


*sources, target = map(Path, sys.argv[1:])
values = {name: value for source in sources for name, value in constants(source.read_text()).items()}
target.parent.mkdir(parents=True, exist_ok=True)
target.write_text(header(values, [source.name for source in sources]))
