"""The methods as subcommands: ``ringlight train SCENE METHOD``, every field of the recipe a flag."""

from typing import Annotated, Any

import tyro

from ringlight.methods.table import METHODS

Method = Annotated[tyro.extras.subcommand_type_from_defaults(METHODS, prefix_names=False), tyro.conf.arg(name="")]


def preset_of(arguments: list[str], recipe: Any) -> str:
    """The name under which the recipe was asked for: the first word that names a preset of its kind."""
    named = [word for word in arguments if word in METHODS and type(METHODS[word]) is type(recipe)]
    return named[0] if named else next(name for name, preset in METHODS.items() if type(preset) is type(recipe))
