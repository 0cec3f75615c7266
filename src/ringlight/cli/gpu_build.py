"""One sentence before minutes of silence: gsplat's kernels are about to be built."""

import importlib.util
import sys

from ringlight.core.words import counted


def tell_of_build(device: str) -> None:
    """Say on standard error that the first picture on a GPU takes minutes, where ``device`` leads to one.

    To be called before the back end is chosen, which builds the kernels.
    """
    if device not in ("auto", "cuda") or importlib.util.find_spec("gsplat") is None:
        return
    from ringlight.rasterize.choose import has_gpu
    from ringlight.rasterize.gsplat_build import is_built, safe_jobs

    if has_gpu() and not is_built():
        sys.stderr.write(
            f"building gsplat's kernels for this GPU, {counted(safe_jobs(), 'compiler')} at a time: once, and it takes "
            "minutes; if it fails, 'ringlight doctor' says what is missing\n"
        )
