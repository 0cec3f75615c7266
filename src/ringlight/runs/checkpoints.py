"""The last two checkpoints of a run: where it goes on after whatever stopped it."""

import re
from collections.abc import Mapping

from torch import Tensor

from ringlight.core.lost_disk import what_helps
from ringlight.errors import ModelFileError, OutputError, RunError
from ringlight.files.atomic import flushed_names
from ringlight.files.tensor_file import TensorFile, read_tensors, write_tensors
from ringlight.files.tensor_header import REMEDY
from ringlight.fit.guard import good_state
from ringlight.fit.train import Training
from ringlight.runs.folder import EARLIER_NAME, FRESH_NAME, RunFolder

LARGEST_COUNT = 2**31 - 1
"""Of steps, updates, faults and collapses: any more is a damaged number."""


MODEL, MOMENTS = "model.", ("optimizer.mean.", "optimizer.square.")

STORED_BY_NAME = (MODEL, *MOMENTS)
"""What a state holds of each of the model's tensors."""


GUARD = "guard."
"""What a state holds of the guard, and in it of the training at an earlier step."""

OF_STRATEGY = re.compile(r"(strategy\.\d+)\.(.+)")
"""A name of what a strategy keeps: its number, and what it calls it. Means of models are called as their tensors."""

COUNTED = ("strategy.", GUARD + "collapses")
"""Of which there may be more with time."""


def write_checkpoint(folder: RunFolder, state: Mapping[str, Tensor], facts: Mapping[str, str]) -> None:
    """Write the newest and keep the one before it. Raises OutputError, with both of them as they were.

    Whenever the process is killed, whole checkpoints lie under the names of ``RunFolder.checkpoints``.
    """
    fresh = folder.path / FRESH_NAME
    write_tensors(fresh, state, facts)
    try:
        with flushed_names(folder.path):
            if folder.checkpoint.exists():
                folder.checkpoint.replace(folder.path / EARLIER_NAME)
            fresh.replace(folder.checkpoint)
    except OSError as error:
        choose = what_helps(error, "choose another folder")
        raise OutputError(f"{folder.checkpoint}: cannot be written: {error.strerror}; {choose}") from error


def refuse_misfits(state: Mapping[str, Tensor], training: Training) -> None:
    """Raise KeyError or ValueError unless ``state`` can be restored in ``training``, which is at its start.

    The model has grown since, and with its rows what a strategy counts for each; everything else has its old shape. So
    has the state that a guard keeps, of another number of rows.
    """
    own = training.state()
    resized = _parts_of(training.model.resized_prefixes)
    fixed = {name: tensor for name, tensor in own.items() if not name.startswith(resized)}
    _refuse_other_shapes(state, fixed, training.model.row_prefixes)
    _refuse_other_means({name: t for name, t in state.items() if name.startswith((MODEL, "strategy."))}, own)
    _refuse_uneven(state, {name: tensor for name, tensor in own.items() if name not in fixed})
    of_guard = {name.removeprefix(GUARD): t for name, t in state.items() if name.startswith(GUARD)}
    kept = good_state(of_guard)
    if kept:
        of_training = {name: tensor for name, tensor in own.items() if not name.startswith(GUARD)}
        _refuse_other_means(kept, of_training)
        _refuse_other_shapes(kept, of_training, training.model.row_prefixes)


def _refuse_other_means(state: Mapping[str, Tensor], own: Mapping[str, Tensor]) -> None:
    """Raise ValueError unless what a state holds and one at its start does not are means, each of all parameters."""
    averaged = {name.removeprefix(MOMENTS[0]) for name in own if name.startswith(MOMENTS[0])}
    means: dict[str, set[str]] = {}
    for name in sorted(state.keys() - own.keys()):
        part = OF_STRATEGY.fullmatch(name)
        if part is None or part[2] not in averaged:
            raise ValueError(f"{name} is unknown")
        found, of_model = state[name], state[MODEL + part[2]]
        if (found.dtype, found.shape) != (of_model.dtype, of_model.shape):
            raise ValueError(f"{name} is {found.dtype} of shape {list(found.shape)}")
        means.setdefault(part[1], set()).add(part[2])
    for strategy, names in means.items():
        if names != averaged:
            raise ValueError(f"{strategy}.{min(averaged - names)} is missing")


def _parts_of(prefixes: tuple[str, ...]) -> tuple[str, ...]:
    """How names of a state begin whose tensors' names do."""
    return tuple(part + prefix for prefix in prefixes for part in STORED_BY_NAME)


def _refuse_uneven(state: Mapping[str, Tensor], resized: Mapping[str, Tensor]) -> None:
    """Raise KeyError or ValueError unless these are of the old type and moments have their parameters' shapes. That
    these fit each other is asked of the model when it takes them."""
    for name, tensor in resized.items():
        found = state[name]
        of_model = next((MODEL + name.removeprefix(part) for part in MOMENTS if name.startswith(part)), name)
        alike = (found.dtype, found.ndim) == (tensor.dtype, tensor.ndim)
        if not alike or found.shape != state[of_model].shape:
            raise ValueError(f"{name} is {found.dtype} of shape {list(found.shape)}")


def _refuse_other_shapes(state: Mapping[str, Tensor], own: Mapping[str, Tensor], prefixes: tuple[str, ...]) -> None:
    of_rows = _parts_of(prefixes)
    rows = next((state[name].shape[:1] for name in own if name.startswith(of_rows)), ())
    for name, tensor in own.items():
        found = state[name]
        of_row = name.startswith(of_rows)
        shape = (*rows, *tensor.shape[1:]) if of_row else tuple(tensor.shape)
        counted = name.startswith(COUNTED) and found.ndim == tensor.ndim
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
