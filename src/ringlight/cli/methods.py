"""The methods as subcommands: ``ringlight train SCENE METHOD``, every field of the recipe a flag."""

import dataclasses
from typing import Annotated, Any

import tyro

from ringlight.methods.recipe import Recipe
from ringlight.methods.table import ABOUT, METHODS, method_of

Method = Annotated[
    tyro.extras.subcommand_type_from_defaults(METHODS, ABOUT, prefix_names=False), tyro.conf.arg(name="")
]


def preset_of(arguments: list[str], recipe: Recipe) -> str:
    """The name under which the recipe was asked for.

    A folder may be called like a preset, so of the words that name one of the recipe's kind it is the one whose
    settings the recipe keeps most of.
    """
    named = [word for word in arguments if word in METHODS and type(METHODS[word]) is type(recipe)]
    return min(named, key=lambda name: _changes(METHODS[name], recipe)) if named else method_of(recipe)


def _changes(preset: Any, recipe: Any) -> int:
    """Settings in which two recipes of one kind differ, groups counted one by one."""
    pairs = [(getattr(preset, field.name), getattr(recipe, field.name)) for field in dataclasses.fields(preset)]
    return sum(_changes(ours, theirs) if dataclasses.is_dataclass(ours) else ours != theirs for ours, theirs in pairs)
