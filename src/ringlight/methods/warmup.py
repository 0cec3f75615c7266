"""How long base colours are shown alone, before what a surface reflects is added. Torch-free.

What base colours make of a mirror's pictures lies behind its surface, and draws the surface there. On held-out views
twelve balls of ringlight-mirror lose 0.5 dB with 300 such steps of 3,000, and 1.1 with 700 of 7,000
(docs/experiments/mirrors.md); varnish of 3dgs-dr loses 0.5 with 1,500 of 30,000, for then a hull's normals are lost
(docs/methods/3dgs-dr.md).
"""

import math

from ringlight.errors import RecipeError

WARMUP, MOST_WARMUP_STEPS = 0.05, 150
"""Share of the steps that show base colours alone, and how many these are at most, of a subject that is cut out."""


def check_warmup(warmup: float | None) -> None:
    """Raises RecipeError for what is no share."""
    if warmup is not None and not 0 <= warmup <= 1:
        raise RecipeError(f"warmup is {warmup:g}; give a share of the steps, from 0 to 1")


def unlit_share(warmup: float | None, steps: int) -> float:
    """The share as set, or as suits a run of so many ``steps``."""
    # nextafter: no rounding makes a step less of it.
    return min(WARMUP, math.nextafter(MOST_WARMUP_STEPS / max(steps, 1), 1)) if warmup is None else warmup
