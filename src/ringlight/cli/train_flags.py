"""Flags of ``ringlight train`` in a wrong place or with a wrong method: told before the parser sees them."""

from ringlight.cli.flags import flags_in, flags_of, near
from ringlight.cli.parse import refuse
from ringlight.core.command_line import command
from ringlight.errors import RecipeError
from ringlight.methods.table import METHODS, method_named


def refuse_unknown_and_misplaced_flags(arguments: list[str], of_any_method: set[str]) -> None:
    """The parser would take the value of an unknown flag for the scene, and complain of that; of one that stands
    before its method it would say that it does not know it."""
    known = of_any_method.union(*(flags_of(type(recipe), in_pairs=True) for recipe in METHODS.values()))
    for flag in flags_in(arguments):
        if flag not in known:
            method = None if "--resume" in flags_in(arguments) else method_among(arguments)
            own = of_any_method | flags_of(type(METHODS[method]), in_pairs=True) if method else known
            meant = near(flag, own, known)
            perhaps = f"; perhaps you meant {meant}" if meant else ""
            refuse("train", f"not understood: {flag}{perhaps}", f"SCENE {method}" if method else "")
    if "--resume" in flags_in(arguments):
        return
    _refuse_unknown_method(arguments)
    at = next((place for place, word in enumerate(arguments) if word in METHODS), len(arguments))
    for flag in flags_in(arguments[:at]):
        if flag not in of_any_method:
            refuse("train", f"{flag} is a method's and goes behind its name: ringlight train SCENE METHOD {flag} …")


def method_among(arguments: list[str]) -> str | None:
    """The method that is named last, for a folder may be called like one; rather none that may be a flag's value, such
    as ``--out 3dgs``. None where none is named."""
    values = _values(arguments)
    named = [at for at, word in enumerate(arguments) if word in METHODS]
    sure = [at for at in named if at not in values]
    return arguments[(sure or named)[-1]] if named else None


def _values(arguments: list[str]) -> set[int]:
    """Places of words that may be a flag's value."""
    return {at + 1 for at, word in enumerate(arguments) if word.startswith("--") and "=" not in word}


def _refuse_unknown_method(arguments: list[str]) -> None:
    """Or one that is missing: a method's flag would be refused before, and the parser lists all words that it knows."""
    is_named = METHODS.keys() & set(arguments)  # also behind a flag without a value: --quiet 3dgs
    if is_named or not arguments or arguments[0].startswith("-") or {"-h", "--help"} & set(arguments):
        return
    scene, *others = (word for at, word in enumerate(arguments) if at not in _values(arguments) and word[:1] != "-")
    if not others:
        chosen = command("train", scene, "ringlight", *arguments[1:])
        refuse("train", f"a method is missing behind {scene}; 'ringlight' chooses one for the scene: {chosen}")
    try:
        method_named(others[0])
    except RecipeError as error:
        refuse("train", str(error))


def refuse_flags_of_other_methods(arguments: list[str], of_any_method: set[str]) -> None:
    """The parser would not say all methods that a flag belongs to."""
    named = [word for word in arguments if word in METHODS]  # a folder may be called like a method
    own = of_any_method.union(*(flags_of(type(METHODS[name]), in_pairs=True) for name in named))
    for flag in flags_in(arguments):
        if named and flag not in own:
            owners = [name for name, recipe in METHODS.items() if flag in flags_of(type(recipe), in_pairs=True)]
            *others, last = owners
            takers = f"{', '.join(others)} or {last}" if others else last
            refuse("train", f"{flag} is no setting of {named[-1]}; give it to {takers}")
