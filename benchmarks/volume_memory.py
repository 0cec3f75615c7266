"""The most memory that a step of a volume takes for each sample in a fog: python benchmarks/volume_memory.py

Beside it stands what a run counts for one before it begins. All samples are seen, and rays go through the whole box.
"""

import sys

import torch
import volume_workload
from volume_workload import batch

from ringlight import _kernels
from ringlight.core.want import Want
from ringlight.measure.peak_memory import PeakMemory
from ringlight.methods.putt import PuttRecipe
from ringlight.methods.tensorf import TensorfRecipe
from ringlight.methods.volume_memory import FLOAT_BYTES
from ringlight.volume import model as of_model

FOG, FEW_RAYS, MORE, SIDE = -5.0, 8192, 2, 128
"""Of SHIFT; and rays whose samples show what one takes, by how much more as many times so many do."""

KINDS = {
    "tensorf": TensorfRecipe(),
    "tensorf, where all samples hand their gradient on": TensorfRecipe(gradient_share=1.0),
    "tensorf of three lines": TensorfRecipe(decomposition="cp"),
    "putt": PuttRecipe(),
}


def fog_of(recipe: TensorfRecipe | PuttRecipe) -> of_model.VolumeModel:
    """Nothing of it is known to be empty."""
    box = torch.tensor([[-1.0] * 3, [1.0] * 3])
    model = recipe.model_of(SIDE if isinstance(recipe, PuttRecipe) else (SIDE,) * 3, box)
    model.gradient_share = recipe.gradient_share
    return model


def taken(model: of_model.VolumeModel, rays: int) -> tuple[int, int]:
    """Bytes of a step above what there was, and its samples."""
    volume_workload.RAYS = rays
    looked_at = batch()
    memory = PeakMemory()
    shown = model.predict(looked_at, Want.GRADIENTS)
    shown.backward(torch.ones_like(shown.color) / rays, {})
    return memory.growth() or 0, int(model.samples_of(looked_at.rays).sum())


def main() -> None:
    """Print a line for each kind."""
    torch.set_num_threads(1)
    _kernels.set_threads(1)
    _kernels.keep_freed_memory()
    of_model.SHIFT = FOG
    for name, recipe in KINDS.items():
        model = fog_of(recipe)
        taken(model, FEW_RAYS)
        (few, fewer), (much, more) = (taken(model, rays) for rays in (FEW_RAYS, MORE * FEW_RAYS))
        counted = FLOAT_BYTES * recipe.numbers_of_sample
        sys.stdout.write(
            f"{name}: {(much - few) / (more - fewer):.0f} bytes a sample, {counted} are counted; {more:,} samples take "
            f"{much / 1e6:,.0f} MB at most\n"
        )
        sys.stdout.flush()


if __name__ == "__main__":
    main()
