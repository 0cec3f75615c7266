"""The parts of docs/extending.md: written to the files that it names, and plugged in by the lines that it gives."""

import re
import sys
from importlib import import_module
from inspect import unwrap
from pathlib import Path
from types import ModuleType
from typing import Any, Literal, get_args

import pytest

from ringlight.color.ringlight_settings import RingLightSettings

TEXT = (Path(__file__).parents[1] / "docs" / "extending.md").read_text(encoding="utf-8")

FILES: dict[str, str] = dict(re.findall(r"```python\n# src/(\S+)\n(.*?)```", TEXT, re.DOTALL))
"""By path below src/."""

LINES: list[tuple[str, str, str]] = re.findall(r"line\sin\s`(\w+)`\sof\s`([\w/]+\.py)`:\s`([^`]+)`", TEXT)
"""Table, its file below src/ringlight/ or from the root, and the line."""


def plugged_in(folder: Path, patch: pytest.MonkeyPatch) -> dict[str, Any]:
    """Do what the page says, with its files in ``folder`` in place of src/; gives what they define, by name."""
    names = _written(folder, patch)
    for table, path, line in LINES:
        module = import_module(_module_of(path))
        for key, value in eval("{" + line + "}", vars(module) | names).items():
            patch.setitem(getattr(module, table), key, value)
    _name_the_field("fourier", patch)
    return names


def _written(folder: Path, patch: pytest.MonkeyPatch) -> dict[str, Any]:
    modules = {_module_of(path.removeprefix("ringlight/")): folder / path for path in FILES}
    for (name, place), source in zip(modules.items(), FILES.values(), strict=True):
        place.parent.mkdir(parents=True)
        place.write_text(source, encoding="utf-8")
        package = import_module(name.rpartition(".")[0])
        patch.setattr(package, "__path__", [*package.__path__, str(place.parent)])
        patch.setitem(sys.modules, name, ModuleType(name))  # so that the import below is undone too
        del sys.modules[name]
    named = [vars(import_module(name)).items() for name in modules]
    return {name: value for items in named for name, value in items if not name.startswith("_")}


def _module_of(path: str) -> str:
    dotted = path.removesuffix(".py").replace("/", ".")
    return dotted.removeprefix("tests.") if dotted.startswith("tests.") else f"ringlight.{dotted}"


def _name_the_field(name: str, patch: pytest.MonkeyPatch) -> None:
    """The name in the ``Literal``. Tests check shapes and types around ``__init__`` as the file has it, so not here."""
    annotations = RingLightSettings.__annotations__
    patch.setitem(annotations, "field", Literal[(*get_args(annotations["field"]), name)])
    patch.setattr(RingLightSettings, "__init__", unwrap(RingLightSettings.__init__))
