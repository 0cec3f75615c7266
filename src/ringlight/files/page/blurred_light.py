"""A rough environment as a page gets it: its blurred maps in place of the texels that they are made of.

To blur takes a sparse matrix that is far larger than what comes out. Maps are smooth, so that their differences from
texel to texel take few bytes.
"""

import torch
from jaxtyping import Float
from torch import Tensor

from ringlight.color.specular_table import specular_table
from ringlight.color.split_sum import SplitSumLight
from ringlight.fields.cubemap import FACES
from ringlight.files.pack_numbers import BYTE, Parts, pack_in_steps
from ringlight.files.packed import SEPARATOR, Packed, unpack_tensors

TEXELS, MAPS, SHARES = "color.light.texels", "color.light.maps", "shares"

STEP = 1 / 2048
"""Of what is stored here, which lies in [0, 1]: its rounding alone is 77 dB below white."""


def with_maps(packed: Packed, light: SplitSumLight) -> Packed:
    """``packed`` with "color.light.maps" [T 3], in [0, 1], for the texels of ``light`` and of each pack's, and with
    "shares" [P 2], F0 and F1 of :func:`specular_table`, row by row.

    The maps follow each other as ``light.levels`` do, without borders.
    """
    of_lights, others = _parted(packed)
    maps = {name.replace(TEXELS, MAPS): _maps(light, texels) for name, texels in unpack_tensors(of_lights).items()}
    parts = {name: _parts(values) for name, values in (maps | {SHARES: specular_table().flatten(1).T}).items()}
    tensors = {f"{name}{SEPARATOR}{part}": found[part] for name, found in parts.items() for part in found}
    packing = {name: f"fixed{BYTE * found['codes'].shape[-1]}" for name, found in parts.items()}
    return Packed(others.tensors | tensors, others.packing | packing)


def _parts(values: Float[Tensor, "R C"]) -> Parts:
    return pack_in_steps(values, torch.full(values.shape[1:], STEP, dtype=torch.float64))


def _parted(packed: Packed) -> tuple[Packed, Packed]:
    """The environments' texels, and all else."""
    names = {stored: stored.partition(SEPARATOR)[0] for stored in packed.tensors}
    halves = [
        Packed(
            {stored: tensor for stored, tensor in packed.tensors.items() if names[stored].endswith(TEXELS) == wanted},
            {name: kind for name, kind in packed.packing.items() if name.endswith(TEXELS) == wanted},
        )
        for wanted in (True, False)
    ]
    return halves[0], halves[1]


@torch.no_grad()
def _maps(light: SplitSumLight, texels: Float[Tensor, "6 S S 3"]) -> Float[Tensor, "T 3"]:
    sides = [level.side for level in light.levels]
    bordered = light.maps_of(texels.to(light.texels)).cpu().split([FACES * (side + 2) ** 2 for side in sides])
    inner = [rows.view(FACES, side + 2, side + 2, 3)[:, 1:-1, 1:-1] for rows, side in zip(bordered, sides, strict=True)]
    return torch.cat([faces.reshape(-1, 3) for faces in inner])
