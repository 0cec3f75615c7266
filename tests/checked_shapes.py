"""Arrays are held against the shapes in signatures; all else in a signature is left to mypy.

jaxtyping's own decorator binds each call's arguments by name, holds all of them against their types, and does so once
more when the result is there: half of the suite's time. Here functions without arrays are left as they are, and those
with arrays have only these checked, once.
"""

import functools
import io
from collections.abc import Callable
from contextlib import redirect_stdout
from typing import Any, TypeVar, get_args

import jaxtyping
from beartype import beartype
from beartype.roar import BeartypeCallHintViolation

Defined = TypeVar("Defined", bound=Callable[..., Any])

ONE_SCOPE = jaxtyping.jaxtyped("context")
"""Within it a letter of a shape is one number."""


def has_array(hint: object) -> bool:
    """Whether the type is an array's, or made of some."""
    parts = get_args(hint)
    return any(map(has_array, parts)) if parts else isinstance(hint, type) and issubclass(hint, jaxtyping.AbstractArray)


def checked(defined: Defined) -> Defined:
    """The function, or the dataclass, whose arrays are held against their shapes in every call.

    Raises (in calls):
        TypeError: an array is of another shape or type, or a letter stands for two numbers.
    """
    if isinstance(defined, type):
        if "__init__" in vars(defined) and not hasattr(defined.__init__, "__wrapped__"):
            defined.__init__ = checked(defined.__init__)
        return defined
    hints = {name: hint for name, hint in defined.__annotations__.items() if has_array(hint)}
    if not hints:
        return defined

    # beartype would check a generator's arguments where it is first asked for something, in whose scope that is.
    @functools.wraps(defined)
    def called(*args: Any, **named: Any) -> Any:
        return defined(*args, **named)

    called.__annotations__ = hints
    strict = beartype(called)

    @functools.wraps(defined)
    def in_one_scope(*args: Any, **named: Any) -> Any:
        with ONE_SCOPE:
            try:
                return strict(*args, **named)
            except BeartypeCallHintViolation as error:
                with redirect_stdout(io.StringIO()) as numbers:
                    jaxtyping.print_bindings()
                raise TypeError(f"{error}\n{numbers.getvalue()}") from None

    return in_one_scope


def check_shapes_of(package: str) -> None:
    """Every function and dataclass of the package that is imported from now on is checked."""
    # The hook looks the decorator up by this name where each function is defined.
    jaxtyping.jaxtyped = lambda *, typechecker: checked
    jaxtyping.install_import_hook(package, None)
