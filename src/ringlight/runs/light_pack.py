"""A light pack: what of a model is another in other light, packed, for the one model that it belongs to.

It holds the tensors that all Gaussians share and that differ, as ``ringlight compress`` packs them, and for a shared
basis ``colors`` [3 4]: what the base colours become, shared too, as factors of red, green, blue and one.
"""

import hashlib
import json
import re
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import torch
from jaxtyping import Float
from torch import Tensor

from ringlight.color.shared_basis import DC
from ringlight.color.varying_mirror import OPACITY_BASES
from ringlight.core.gradients import COLUMNS
from ringlight.core.sh_basis import rgb_from_sh, sh_from_rgb
from ringlight.errors import ModelFileError, RunError
from ringlight.files.model_file import LIGHT_PROGRAM
from ringlight.files.packed import Packed, pack_tensors, unpack_tensors
from ringlight.files.tensor_file import read_metadata, read_tensors, write_tensors
from ringlight.methods.store import StoredModel, model_of_tensors, tensors_from_cameras

PACK_NAME = "light.safetensors"
"""In the folder of the run that learned it."""

FORMAT = 1

COLORS = "colors"

NEAR_ENOUGH = 1e-4
"""Largest difference of a constant coefficient from what the shared transform makes of it: rounding."""


@dataclass(frozen=True)
class LightPack:
    """``scene`` names whose light it is, ``model`` is the :func:`model_mark` that it fits; ``stored`` are its tensors
    as they lie in the file."""

    path: Path
    scene: str
    model: str
    stored: Packed

    @property
    def tensors(self) -> dict[str, Tensor]:
        """Unpacked, float32."""
        return unpack_tensors(self.stored)


def model_mark(stored: StoredModel) -> str:
    """A digest of all that a picture of the model depends on."""
    digest = hashlib.blake2b(digest_size=16)
    digest.update(json.dumps([stored.header.method, stored.header.recipe], sort_keys=True).encode())
    for name, tensor in sorted(stored.model.rendering_tensors().items()):
        digest.update(f"{name} {tensor.dtype} {list(tensor.shape)}".encode())
        digest.update(tensor.detach().cpu().contiguous().reshape(-1).view(torch.uint8).numpy().data)
    return digest.hexdigest()


def pack_between(model: StoredModel, relit: Mapping[str, Tensor], scene: str, path: Path) -> LightPack:
    """The pack that makes ``model`` show what the tensors of ``relit`` show. Raises RunError where more differs than
    light may change."""
    own, found = model.model.rendering_tensors(), {}
    for name, tensor in own.items():
        other = relit[name]
        if torch.equal(tensor, other):
            continue
        if name == COLUMNS + DC:
            found[COLORS] = _transform_between(tensor, other)
        is_light = not name.startswith(COLUMNS) and name not in OPACITY_BASES
        if not is_light and (name != COLUMNS + DC or not _transformed_is(tensor, other, found[COLORS])):
            raise RunError(
                f"{path}: its {name} is not that of the model that it started from, which has changed since; relight "
                "the model as it is now, into another folder"
            )
        if is_light:
            found[name] = other.detach().cpu()
    return LightPack(path, scene, model_mark(model), pack_tensors(found))


def write_pack(pack: LightPack) -> int:
    """Write it at its path, all or nothing; returns its bytes. Raises OutputError."""
    metadata = {
        "program": LIGHT_PROGRAM,
        "format": str(FORMAT),
        "scene": pack.scene,
        "model": pack.model,
        "packing": json.dumps(pack.stored.packing, sort_keys=True),
    }
    write_tensors(pack.path, pack.stored.tensors, metadata)
    return pack.path.stat().st_size


def read_pack(path: Path) -> LightPack:
    """From its file, or the folder that holds it. Raises ModelFileError for one that is damaged, newer, or no pack."""
    if path.is_dir():
        path = path / PACK_NAME
    metadata = read_metadata(path)
    if metadata.get("program") != LIGHT_PROGRAM:
        raise ModelFileError(f"{path}: is no light pack; name a file or folder that 'ringlight relight' wrote")
    damaged = ModelFileError(f"{path}: the light pack is damaged; copy it again, or make it again: ringlight relight")
    if not re.fullmatch("[0-9]{1,9}", metadata.get("format", "")):
        raise damaged
    if int(metadata["format"]) > FORMAT:
        raise ModelFileError(f"{path}: was written by a newer ringlight; run pip install --upgrade ringlight")
    tensors = read_tensors(path, checksum_required=True).tensors
    try:
        packing = {str(name): str(kind) for name, kind in json.loads(metadata["packing"]).items()}
        pack = LightPack(path, metadata["scene"], metadata["model"], Packed(tensors, packing))
        unpacked = pack.tensors
    except (KeyError, ValueError, AttributeError, RecursionError, ModelFileError):
        raise damaged from None
    colors = unpacked.get(COLORS)
    if colors is not None and (colors.shape != (3, 4) or not bool(colors.isfinite().all())):
        raise damaged
    return pack


def relit(stored: StoredModel, pack: LightPack, file: Path) -> StoredModel:
    """The model in the light of ``pack``; ``file`` is named in the ModelFileError for a pack of another model."""
    if model_mark(stored) != pack.model:
        raise ModelFileError(
            f"{pack.path}: belongs to another model than {file}; name the model that was relit, not a copy that was "
            "compressed, edited or trained further"
        )
    own, light = stored.model.rendering_tensors(), pack.tensors
    colors = light.pop(COLORS, None)
    if colors is not None:
        own[COLUMNS + DC] = transformed(own[COLUMNS + DC], colors)
    return model_of_tensors(
        own | light | tensors_from_cameras(stored.cameras), stored.header, stored.rasterize, pack.path
    )


def transformed(dc: Float[Tensor, "N 3"], colors: Float[Tensor, "3 4"]) -> Float[Tensor, "N 3"]:
    """Constant coefficients whose base colours are those of ``dc`` under ``colors``."""
    shown = rgb_from_sh(dc.detach().double())
    matrix = colors.double().to(shown.device)
    # Sums of three written out: how many threads a product takes must not matter.
    made = sum(shown[:, k, None] * matrix[:, k] for k in range(3)) + matrix[:, 3]
    assert isinstance(made, Tensor)
    return sh_from_rgb(made).float()


def _transform_between(before: Float[Tensor, "N 3"], after: Float[Tensor, "N 3"]) -> Float[Tensor, "3 4"]:
    """Float32, by least squares; exact but for rounding where there is one."""
    shown, wanted = (rgb_from_sh(dc.detach().cpu().double()).numpy() for dc in (before, after))
    return least_squares(np.concatenate([shown, np.ones_like(shown[:, :1])], 1), wanted)


def least_squares(seen: Float[np.ndarray, "P 4"], wanted: Float[np.ndarray, "P 3"]) -> Float[Tensor, "3 4"]:
    """What takes rows of ``seen`` nearest to those of ``wanted``; NumPy's sums do not depend on threads."""
    squares = np.array([[(seen[:, a] * seen[:, b]).sum() for b in range(4)] for a in range(4)])
    products = np.array([[(seen[:, a] * wanted[:, c]).sum() for c in range(3)] for a in range(4)])
    return torch.from_numpy(np.linalg.lstsq(squares, products, rcond=None)[0].T.copy()).float()


def _transformed_is(before: Tensor, after: Tensor, colors: Tensor) -> bool:
    return bool(((transformed(before, colors) - after).abs() < NEAR_ENOUGH).all())
