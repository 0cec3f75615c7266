"""A model with edited light, written as a model file like any other."""

from dataclasses import asdict, dataclass, replace
from pathlib import Path

import ringlight
from ringlight.files.model_file import write_model_file
from ringlight.methods.light_edit import LightEdit, edited
from ringlight.methods.store import model_of_tensors, tensors_from_cameras
from ringlight.runs.light_pack import LightPack, relit
from ringlight.runs.opened import Opened, scene_facts_of


@dataclass(frozen=True)
class EditedModel:
    """What was written. ``base`` and ``residual`` are the factors of red, green and blue; ``clipped`` is the share of
    base colour values that would be brighter than white."""

    file: str
    bytes_file: int
    counted: int
    noun: str
    base: tuple[float, float, float]
    residual: tuple[float, float, float]
    light: str | None
    """Name of the scene whose light a pack brought."""
    clipped: float
    edits: int
    """In the file, with those that the model had before."""


def edit_light(opened: Opened, path: Path, edit: LightEdit, pack: LightPack | None = None) -> EditedModel:
    """Write the model with the light of ``pack``, if there is one, edited by ``edit``.

    Measures on photographs are left out: they are of the model as it was. Raises RecipeError where there is nothing to
    edit, OutputError where the file cannot be written.
    """
    stored = opened.stored if pack is None else relit(opened.stored, pack, opened.file)
    found = edited(stored.model, stored.header.recipe, edit)
    done: list[dict[str, object]] = [{"light": pack.scene}] if pack else []
    done.append({"base": list(edit.base), "residual": list(edit.residual)})
    header = replace(
        stored.header,
        recipe=found.settings,
        scene=scene_facts_of(opened),
        metrics={},
        storage={},
        versions=stored.header.versions | {"ringlight": ringlight.__version__},
        edits=[*stored.header.edits, *done],
    )
    tensors = found.tensors | tensors_from_cameras(stored.cameras)
    after = model_of_tensors(tensors, header, stored.rasterize, path)
    write_model_file(path, tensors, header)
    return EditedModel(
        str(path),
        path.stat().st_size,
        *after.model.counted(),
        **asdict(edit),
        light=None if pack is None else pack.scene,
        clipped=found.clipped,
        edits=len(header.edits),
    )
