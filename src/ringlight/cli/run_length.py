"""How many steps a run may be asked for."""

from ringlight.errors import RecipeError

MOST_STEPS = 10_000_000
"""More than anybody trains. Before its first step a run lists what happens after which one."""


def check_length(steps: int) -> None:
    """Raises RecipeError for a number of ``--steps`` that no run has."""
    if steps < 1:
        raise RecipeError(f"--steps is {steps}; give at least 1")
    if steps > MOST_STEPS:
        raise RecipeError(f"--steps is {steps}; give at most {MOST_STEPS}")
