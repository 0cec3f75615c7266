"""Nothing that reads a file can run what the file says: the whole package is searched for ways to do so."""

import ast
from collections.abc import Iterator
from pathlib import Path

import pytest

import ringlight

PACKAGE = Path(ringlight.__file__).parent
SOURCES = sorted(PACKAGE.rglob("*.py"))

MODULES = {
    "pickle",
    "cPickle",
    "_pickle",
    "dill",
    "cloudpickle",
    "joblib",
    "marshal",
    "shelve",
    "yaml",
    "code",
    "runpy",
}
CALLS = {"eval", "exec", "compile", "__import__", "input"}
METHODS = {
    ("torch", "load"), ("torch.jit", "load"), ("torch.hub", "load"), ("torch.package", "PackageImporter"),
    ("np", "load"), ("numpy", "load"), ("os", "system"), ("os", "popen"), ("os", "execv"), ("pandas", "read_pickle"),
}  # fmt: skip

EXCEPTIONS = {("files/lpips_weights.py", "pickle")}
"""The weights of LPIPS come pickled: the file is known by its SHA-256 before a byte of it is looked at, and its reader
can build arrays and nothing else (tests/files/test_lpips_weights.py)."""


def dotted(node: ast.expr) -> str:
    return ast.unparse(node) if isinstance(node, (ast.Name, ast.Attribute)) else ""


def findings(source: str) -> Iterator[str]:
    """What a source could run a file's content with."""
    for node in ast.walk(ast.parse(source)):
        if isinstance(node, (ast.Import, ast.ImportFrom)):
            names = [node.module or ""] if isinstance(node, ast.ImportFrom) else [name.name for name in node.names]
            yield from (name.split(".")[0] for name in names if name.split(".")[0] in MODULES)
        if isinstance(node, ast.Name) and node.id in CALLS:
            yield node.id
        if isinstance(node, ast.Attribute) and (dotted(node.value), node.attr) in METHODS:
            yield f"{dotted(node.value)}.{node.attr}"
        if isinstance(node, ast.keyword) and node.arg in ("allow_pickle", "shell"):
            yield str(node.arg)


def test_the_package_is_searched_whole():
    assert len(SOURCES) > 100
    assert {path.parent.name for path in SOURCES} >= {"data", "files", "runs", "cli", "methods", "measure"}


@pytest.mark.parametrize(
    "source",
    ["import pickle", "from pickle import loads", "import torch\ntorch.load('f')", "eval('1')", "f = exec",
     "import yaml",
     "import numpy as np\nnp.load('f', allow_pickle=True)", "import os\nos.system('ls')", "run('ls', shell=True)"],
)  # fmt: skip
def test_the_search_finds(source: str):
    assert list(findings(source))


def test_no_file_can_run_code():
    found = {(path.relative_to(PACKAGE).as_posix(), what) for path in SOURCES for what in findings(path.read_text())}
    assert found == EXCEPTIONS
