"""``ringlight info`` of a model whose file tells no recipe."""

from dataclasses import replace
from pathlib import Path

from command import Command

from ringlight.runs import facts


def test_a_model_without_a_recipe_says_its_step_alone(run_folder: Path, ringlight: Command, monkeypatch) -> None:
    real = facts.facts_of
    monkeypatch.setattr(facts, "facts_of", lambda path: _without_recipe(real(path), replace))
    shown = ringlight("info", run_folder).out
    assert "step 40\n" in shown
    assert "None" not in shown.splitlines()[1]


def _without_recipe(found, replace):  # type: ignore[no-untyped-def]
    return replace(found, run=None, header=replace(found.header, recipe={}))
