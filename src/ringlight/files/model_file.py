"""A trained model in one file: tensors by name and a header of plain facts; knows no method.

Metadata of the safetensors file, all strings: ``program`` "ringlight", ``format`` a number, ``method``, ``preset``,
``step``, ``counted``, ``noun``, ``created``, and as JSON ``recipe``, ``scene``, ``metrics``, ``versions``, ``packing``:
how each packed tensor is stored, by name, ``storage``: what packing cost, and, where there are any, ``edits``. Of
``metrics`` and ``storage`` numbers may be infinite or NaN, as ``core/json_numbers.py`` spells them.
"""

import json
import re
from collections.abc import Mapping
from dataclasses import asdict, dataclass, field
from pathlib import Path

from torch import Tensor

from ringlight.core.json_numbers import read_back, spelled
from ringlight.errors import ModelFileError
from ringlight.files.packed import Packed, unpack_tensors
from ringlight.files.tensor_file import read_metadata, read_tensors, write_tensors

FORMAT = 1
"""Raised when an older program would misread the file. Newer files are refused with the version to install."""

PROGRAM, LIGHT_PROGRAM = "ringlight", "ringlight light"
"""What a model's header says that wrote it, and a light pack's (``runs/light_pack.py``)."""

REMEDY = "copy it again from where it was made, or train again"


@dataclass(frozen=True)
class SceneFacts:
    """What the model was trained on.

    ``resolution`` is width and height of the training images in pixels, ``box`` the axis-aligned box [low, high]
    and ``extent`` the camera extent in world units, ``notes`` what the loader decided; ``source`` the folder, and
    ``options``, a JSON object, how it was read.
    """

    name: str
    source: str
    background: str
    resolution: tuple[int, int]
    box: tuple[tuple[float, float, float], tuple[float, float, float]]
    extent: float
    notes: tuple[str, ...]
    options: dict[str, object]


@dataclass(frozen=True)
class ModelHeader:
    """Everything about a model that is not a tensor.

    ``recipe`` and ``metrics`` are JSON objects; ``versions`` names "ringlight", "torch" and "python"; ``created``
    is a time as the caller writes it, or empty, in which case equal models give equal bytes.
    """

    method: str
    preset: str
    recipe: dict[str, object]
    step: int
    scene: SceneFacts
    metrics: dict[str, object] = field(default_factory=dict)
    versions: dict[str, str] = field(default_factory=dict)
    created: str = ""
    counted: int = 0
    """How many Gaussians, or what ``noun`` says, rendering needs."""
    noun: str = ""
    storage: dict[str, object] = field(default_factory=dict)
    """What packing cost, a JSON object; empty for files that are not packed."""
    edits: list[dict[str, object]] = field(default_factory=list)
    """What 'ringlight edit' did to the light, JSON objects in order; files of earlier versions lack it."""


@dataclass(frozen=True)
class ModelFile:
    """What :func:`read_model_file` returns: tensors on the CPU, unpacked, and as they are ``stored``."""

    tensors: dict[str, Tensor]
    header: ModelHeader
    stored: Packed


def write_model_file(path: Path, tensors: Mapping[str, Tensor] | Packed, header: ModelHeader) -> None:
    """Write all or nothing; equal content gives equal bytes. Raises OutputError, also for a header with a
    number that JSON has not."""
    packed = tensors if isinstance(tensors, Packed) else Packed(dict(tensors), {})
    write_tensors(path, packed.tensors, _metadata_from(header, packed.packing))


def read_model_file(path: Path) -> ModelFile:
    """Tensors and header. Raises ModelFileError for a file that is cut, damaged, newer, or no model of ours."""
    # The header first: a newer format may place its tensors in a way that this program would call damage.
    metadata = read_metadata(path)
    if metadata.get("program") == LIGHT_PROGRAM:
        raise ModelFileError(
            f"{path}: is a light pack, not a model; to have its model in this light: "
            f"ringlight edit MODEL OUT.safetensors --light {path}"
        )
    if metadata.get("program") != PROGRAM:
        raise ModelFileError(
            f"{path}: is a safetensors file, but not a ringlight model; name a model.safetensors "
            "written by 'ringlight train'"
        )
    _refuse_newer(path, metadata)
    header = _header_from(path, metadata)
    packing = {name: str(kind) for name, kind in _object(path, metadata, "packing").items()}
    stored = Packed(read_tensors(path).tensors, packing)
    try:
        tensors = unpack_tensors(stored)
    except ModelFileError as error:
        raise ModelFileError(f"{path}: the file is damaged: {error}; {REMEDY}") from None
    return ModelFile(tensors, header, stored)


def _metadata_from(header: ModelHeader, packing: Mapping[str, str]) -> dict[str, str]:
    values = {name: value for name, value in asdict(header).items() if name != "edits" or value}
    texts = {name: value if isinstance(value, str) else _json(value) for name, value in values.items()}
    return {"program": PROGRAM, "format": str(FORMAT), "packing": _json(dict(packing))} | texts


def _json(value: object) -> str:
    return json.dumps(spelled(value), sort_keys=True, separators=(",", ":"), allow_nan=False)


def _refuse_newer(path: Path, metadata: dict[str, str]) -> None:
    number = metadata.get("format", "")
    if not re.fullmatch(r"[0-9]{1,9}", number):
        raise ModelFileError(f"{path}: the file is damaged: it has no format number; {REMEDY}")
    if int(number) <= FORMAT:
        return
    found = re.search(r'"ringlight":\s*"([0-9][0-9A-Za-z.+-]{0,30})"', metadata.get("versions", ""))
    install = f'pip install "ringlight>={found[1]}"' if found else "pip install --upgrade ringlight"
    raise ModelFileError(
        f"{path}: was written by a newer ringlight (format {number}; this one reads up to {FORMAT}); run {install}"
    )


def _header_from(path: Path, metadata: dict[str, str]) -> ModelHeader:
    """Raises ModelFileError that names the first field that is missing or not what it should be."""
    return ModelHeader(
        method=_text(path, metadata, "method"),
        preset=_text(path, metadata, "preset"),
        recipe=_settings(path, metadata, "recipe"),
        step=_number(path, metadata, "step"),
        scene=_scene_from(path, _object(path, metadata, "scene")),
        metrics=_settings(path, metadata, "metrics"),
        versions={name: str(version) for name, version in _object(path, metadata, "versions").items()},
        created=_text(path, metadata, "created"),
        counted=_number(path, metadata, "counted"),
        noun=_text(path, metadata, "noun"),
        storage=_settings(path, metadata, "storage"),
        edits=_edits(path, metadata),
    )


def _scene_from(path: Path, facts: dict[str, object]) -> SceneFacts:
    try:
        options = facts["options"]
        if not isinstance(options, dict):
            raise TypeError("options")
        width, height = (int(n) for n in facts["resolution"])  # type: ignore[attr-defined]
        low, high = (_corner(corner) for corner in facts["box"])  # type: ignore[attr-defined]
        return SceneFacts(
            name=str(facts["name"]),
            source=str(facts["source"]),
            background=str(facts["background"]),
            resolution=(width, height),
            box=(low, high),
            extent=float(facts["extent"]),  # type: ignore[arg-type]
            notes=tuple(str(note) for note in facts["notes"]),  # type: ignore[attr-defined]
            options=options,
        )
    except (KeyError, TypeError, ValueError, OverflowError) as error:
        raise _damaged(path, "scene") from error


def _corner(values: list[float]) -> tuple[float, float, float]:
    x, y, z = (float(value) for value in values)
    return x, y, z


def _text(path: Path, metadata: dict[str, str], name: str) -> str:
    if name not in metadata:
        raise _damaged(path, name)
    return metadata[name]


def _number(path: Path, metadata: dict[str, str], name: str) -> int:
    text = _text(path, metadata, name)
    if not re.fullmatch(r"[0-9]{1,18}", text):
        raise _damaged(path, name)
    return int(text)


def _object(path: Path, metadata: dict[str, str], name: str) -> dict[str, object]:
    try:
        value = json.loads(_text(path, metadata, name))  # files of earlier versions have Infinity as a bare word
    except (ValueError, RecursionError) as error:
        raise _damaged(path, name) from error
    if not isinstance(value, dict):
        raise _damaged(path, name)
    return value


def _settings(path: Path, metadata: dict[str, str], name: str) -> dict[str, object]:
    """Settings or measures, which may be infinite."""
    return {key: read_back(value) for key, value in _object(path, metadata, name).items()}


def _edits(path: Path, metadata: dict[str, str]) -> list[dict[str, object]]:
    try:
        value = json.loads(metadata.get("edits", "[]"))
    except (ValueError, RecursionError) as error:
        raise _damaged(path, "edits") from error
    if not isinstance(value, list) or not all(isinstance(edit, dict) for edit in value):
        raise _damaged(path, "edits")
    return value


def _damaged(path: Path, name: str) -> ModelFileError:
    return ModelFileError(f"{path}: the file is damaged: '{name}' in its header is missing or unreadable; {REMEDY}")
