"""The last two checkpoints of a run: where it goes on after whatever stopped it."""

from collections.abc import Mapping

from torch import Tensor

from ringlight.errors import ModelFileError, OutputError, RunError
from ringlight.files.atomic import flush_folder
from ringlight.files.tensor_file import REMEDY, TensorFile, read_tensors, write_tensors
from ringlight.runs.folder import EARLIER_NAME, FRESH_NAME, RunFolder

LARGEST_COUNT = 2**31 - 1
"""Of steps, updates and faults: any more is a damaged number."""


def write_checkpoint(folder: RunFolder, state: Mapping[str, Tensor], facts: Mapping[str, str]) -> None:
    """Write the newest and keep the one before it. Raises OutputError, with both of them as they were.

    Whenever the process is killed, whole checkpoints lie under the names of ``RunFolder.checkpoints``.
    """
    fresh = folder.path / FRESH_NAME
    write_tensors(fresh, state, facts)
    try:
        if folder.checkpoint.exists():
            folder.checkpoint.replace(folder.path / EARLIER_NAME)
        fresh.replace(folder.checkpoint)
        flush_folder(folder.path)
    except OSError as error:
        raise OutputError(f"{folder.checkpoint}: cannot be written: {error.strerror}; choose another folder") from error


def refuse_misfits(state: Mapping[str, Tensor], own: Mapping[str, Tensor]) -> None:
    """Raise KeyError or ValueError unless ``state`` can be restored where ``own`` is the state at the start.

    Tables have grown since, and what a strategy counts for each row with them; everything else has its old shape.
    """
    rows, columns = state["model.columns.means"].shape[:1], ("model.columns.", "mean.columns.", "square.columns.")
    for name, tensor in own.items():
        found = state[name]
        of_row = name.removeprefix("optimizer.").startswith(columns)
        shape = (*rows, *tensor.shape[1:]) if of_row else tuple(tensor.shape)
        counted = name.startswith("strategy.") and found.ndim == tensor.ndim
        if found.dtype != tensor.dtype or not (counted or tuple(found.shape) == shape):
            raise ValueError(f"{name} is {found.dtype} of shape {list(found.shape)}")
        if not found.is_floating_point() and not bool(((found >= 0) & (found.long() <= LARGEST_COUNT)).all()):
            raise ValueError(f"{name} counts {found.tolist()}")


def read_checkpoint(folder: RunFolder) -> tuple[TensorFile, tuple[str, ...]]:
    """The newest checkpoint that is whole, and a sentence on each newer one that is damaged.

    Raises RunError where there is none, ModelFileError about the newest where all are damaged.
    """
    damaged: list[str] = []
    for path in folder.checkpoints:
        try:
            stored = read_tensors(path, checksum_required=True)
        except ModelFileError as error:
            damaged.append(str(error).removesuffix(f"; {REMEDY}"))  # nobody has a copy of a checkpoint
            continue
        return stored, tuple(f"{what}; going on from {path.name} instead" for what in damaged)
    if not damaged:
        raise RunError(f"{folder.path}: has no checkpoint yet; start it again with --out NEW")
    others = "no other is left" if len(damaged) == 1 else "the one before it is damaged too"
    raise ModelFileError(f"{damaged[0]}; {others}, so that this run cannot go on: start it again with --out NEW")
