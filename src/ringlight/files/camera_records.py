"""``cameras.json`` beside layers that are numbers: what they mean, and the camera of each, so that depth can be turned
into places."""

import json
from collections.abc import Sequence
from dataclasses import asdict
from pathlib import Path

from ringlight.core.camera import Camera
from ringlight.errors import OutputError
from ringlight.files.atomic import write_text
from ringlight.files.number_files import NumberFormat, Scale
from ringlight.files.rigs import Rig, Stereo

RECORD_NAME = "cameras.json"

MEANINGS = {
    "color": "display-referred sRGB over the background, as photographs; not linear, and not clamped but in png16",
    "base": "base colour over black, display-referred sRGB",
    "residual": "what depends on the view, added to the base colour",
    "modulation": "light modulation, 0 to 1",
    "normal": "unit vector x, y, z in the frame of the world, towards the camera; 0, 0, 0 where there is no surface",
    "depth": "z in the frame of the camera, world units; 0 where there is no surface",
    "alpha": "coverage, 0 to 1",
}
ALONG_RAYS = "distance from the camera along the pixel's ray, world units; 0 where there is no surface"
"""Of depth in a panorama."""


def write_camera_records(
    folder: Path,
    rig: Rig,
    kind: NumberFormat,
    scales: dict[str, Scale],
    names: Sequence[str],
    cameras: Sequence[Camera],
) -> None:
    """Write the record into ``folder``; ``names`` are the files in each layer's folder. Raises OutputError, also over a
    record of numbers that mean something else."""
    layers: dict[str, object] = {}
    for layer, scale in scales.items():
        meaning = ALONG_RAYS if layer == "depth" and rig.name == "panorama" else MEANINGS.get(layer, layer)
        layers[layer] = {"meaning": meaning} | ({"stored": asdict(scale)} if kind == "png16" else {})
    refuse_other_numbers(folder, kind, layers)
    document = {
        "program": "ringlight render",
        "axes": "camera: x right, y down, z forward; pixel centres at .5; world_to_camera is rigid",
        "rig": rig.name,
        **({"baseline": rig.baseline} if isinstance(rig, Stereo) else {}),
        "format": kind,
        **({"value": "low + stored * step"} if kind == "png16" else {}),
        "layers": layers,
        "frames": [_frame(name, camera) for name, camera in zip(names, cameras, strict=True)],
    }
    write_text(folder / RECORD_NAME, json.dumps(document, indent=1) + "\n")


def refuse_other_numbers(folder: Path, kind: str, layers: dict[str, object]) -> None:
    """Raises OutputError where ``folder`` records layers of another format or scale: its older files would lose what
    they mean, and lie among new ones."""
    record = folder / RECORD_NAME
    if not record.exists():
        return
    try:
        old = json.loads(record.read_bytes())
        same = old["format"] == kind and old["layers"] == layers
    except (OSError, ValueError, TypeError, KeyError):
        same = False
    if not same:
        raise OutputError(f"{record}: tells of numbers in another format or scale; choose another folder")


def _frame(name: str, camera: Camera) -> dict[str, object]:
    return {
        "file": name,
        "width": camera.width,
        "height": camera.height,
        "focal": camera.focal,
        "center": camera.center,
        "world_to_camera": camera.world_to_camera.tolist(),
    }
