"""Help costs nothing and is complete: no command loads torch before it knows what it is asked for."""

import importlib
import subprocess
import sys
from pathlib import Path

import pytest

from ringlight.cli.main import VERBS, run
from ringlight.cli.parse import parse
from ringlight.cli.train import TrainArguments
from ringlight.methods.table import CHOOSERS, METHODS
from small_recipes import SPLATS

QUESTIONS = [[], ["--help"], ["--version"], *([verb, "--help"] for verb in VERBS)]
HEAVY = ("torch", "scipy", "PIL")
"""Libraries that take long to load."""

PROBE = f"""
import sys
import ringlight
assert not [name for name in {HEAVY} if name in sys.modules], "import ringlight"
from ringlight.cli.main import run
code = run(sys.argv[1:])
loaded = [name for name in {HEAVY} if name in sys.modules]
assert code == 0 and not loaded, (code, loaded)
"""


@pytest.mark.parametrize("words", QUESTIONS, ids=lambda words: " ".join(words) or "nothing")
def test_help_loads_no_torch(words: list[str]) -> None:
    source = Path(importlib.import_module("ringlight").__file__ or "").parents[1]
    command = [sys.executable, "-c", f"import sys; sys.path.insert(0, {str(source)!r})\n{PROBE}", *words]
    done = subprocess.run(command, capture_output=True, text=True, timeout=60, check=False)
    assert done.returncode == 0, done.stderr
    assert "ringlight" in done.stdout
    assert not done.stderr


@pytest.mark.parametrize("verb", VERBS)
def test_every_command_has_a_module_that_explains_it(verb: str) -> None:
    module = importlib.import_module(f"ringlight.cli.{verb.replace('-', '_')}")
    assert callable(module.main)
    assert (module.__doc__ or "").startswith(f"``ringlight {verb}")


def test_the_overview_names_every_command(capsys: pytest.CaptureFixture[str]) -> None:
    assert run(["--help"]) == 0
    shown = capsys.readouterr().out
    assert all(f"  {verb} " in shown and VERBS[verb] in shown for verb in VERBS)
    assert max(map(len, shown.splitlines())) <= 120


@pytest.mark.parametrize("verb", VERBS)
def test_help_explains_every_option(verb: str, capsys: pytest.CaptureFixture[str]) -> None:
    assert run([verb, "--help"]) == 0
    captured = capsys.readouterr()
    assert captured.out.startswith(f"usage: ringlight {verb}")
    assert "None" not in captured.out, "the words of a person, not of Python"
    assert "(default: )" not in captured.out
    assert "``" not in captured.out
    assert not captured.err


def test_paragraphs_do_not_break_where_the_source_does(capsys: pytest.CaptureFixture[str]) -> None:
    assert run(["train", "scene", "ringlight", "--help"]) == 0
    shown = " ".join(line.strip("│ ") for line in capsys.readouterr().out.splitlines())
    assert "for images up to 200 pixels a side. --points-seed" in " ".join(shown.split())
    lines = [line.strip("│ ") for line in _help_of("train", capsys).splitlines()]
    assert not [line for line in lines if line.startswith("a side")]


@pytest.mark.parametrize("method", [*CHOOSERS, *SPLATS])
def test_settings_that_are_on_or_off_have_the_same_flags_in_all_methods(
    method: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert run(["train", "scene", method, "--help"]) == 0
    shown = capsys.readouterr().out
    for name in ("antialiased", "visible-only"):
        assert f" --{name}, --no-{name} " in shown
    assert "{True,False}" not in shown
    assert "None" not in shown
    assert "--no-quiet" not in shown
    for flags, value in (([], METHODS[method].antialiased), (["--antialiased"], True), (["--no-antialiased"], False)):
        asked = parse(TrainArguments, "train", ["scene", method, *flags], in_pairs=True)
        assert asked.method.antialiased is value


def test_help_says_the_bound_on_gaussians_of_both_ways_to_shade(capsys: pytest.CaptureFixture[str]) -> None:
    assert run(["train", "scene", "ringlight", "--help"]) == 0
    shown = " ".join(line.strip("│ ") for line in capsys.readouterr().out.splitlines())
    _, bound = shown.split("--densify.max-gaussians")
    assert "as many as a training photograph has pixels" in bound
    assert "one for every seven" in bound


def test_flags_that_decide_nothing_are_not_offered(capsys: pytest.CaptureFixture[str]) -> None:
    assert "--points-seed" in _help_of("train", capsys)
    assert "--resume RUN" in _help_of("train", capsys)
    assert "--points-seed" not in _help_of("eval", capsys)


def _help_of(verb: str, capsys: pytest.CaptureFixture[str]) -> str:
    assert run([verb, "--help"]) == 0
    return capsys.readouterr().out
