"""The PLY file that viewers of 3-D Gaussians read; colour is spherical harmonics of degree 0 to 3.

Columns of the element ``vertex``, as the 3DGS release writes them: x y z, nx ny nz (zero), f_dc_0..2,
f_rest_0..3K-1 (channel-major: all K coefficients of red, then green, then blue), opacity (before the sigmoid),
scale_0..2 (natural log), rot_0..3 (wxyz). Colour is max(0, 0.5 + sum of coefficient times basis function).
"""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import torch
from jaxtyping import Float
from torch import Tensor

from ringlight.core.finite import first_not_finite
from ringlight.core.gaussians import Gaussians
from ringlight.errors import ModelFileError
from ringlight.files.atomic import written_atomically
from ringlight.files.ply_header import PlyTable, read_ply_header

MIP_COMMENT = "SplatRenderMode: mip"
"""Viewers that know it render with the antialiased opacity compensation, as the model was trained."""

CHUNK_ROWS = 1 << 16
"""Rows converted at a time: bounds the memory beside the model to 16 MB."""

REST_COUNTS = {0: 0, 9: 3, 24: 8, 45: 15}
"""Number of f_rest columns and of coefficients beyond the constant one, for degrees 0 to 3."""


@dataclass(frozen=True)
class GaussianPly:
    """What a PLY file holds. ``gaussians.appearance`` has "sh_dc" [N 3] and "sh_rest" [N K 3], K = 0, 3, 8 or 15."""

    gaussians: Gaussians
    antialiased: bool


def write_gaussian_ply(
    path: str | Path,
    gaussians: Gaussians,
    sh_dc: Float[Tensor, "N 3"],
    sh_rest: Float[Tensor, "N K 3"],
    antialiased: bool = False,
    comments: Sequence[str] = (),
) -> None:
    """Write all or nothing; K is 0, 3, 8 or 15. Rotations are written with unit length. Raises OutputError."""
    names = _column_names(sh_rest.shape[1])
    # A line break would end the comment and corrupt the header.
    lines = [MIP_COMMENT] * antialiased + [" ".join(comment.split()) for comment in comments]
    header = ["ply", "format binary_little_endian 1.0"]
    header += [f"comment {line}" for line in lines]
    header += [f"element vertex {len(gaussians)}"]
    header += [f"property float {name}" for name in names]
    header += ["end_header", ""]
    with written_atomically(Path(path)) as file:
        file.write("\n".join(header).encode("ascii", "backslashreplace"))
        for begin in range(0, len(gaussians), CHUNK_ROWS):
            part = slice(begin, begin + CHUNK_ROWS)
            columns = [
                gaussians.means[part],
                torch.zeros_like(gaussians.means[part]),
                sh_dc[part],
                sh_rest[part].transpose(1, 2).flatten(1),
                gaussians.opacity_logits[part, None],
                gaussians.log_scales[part],
                torch.nn.functional.normalize(gaussians.quats[part], dim=-1),
            ]
            table = torch.cat([column.detach().cpu().float() for column in columns], 1)
            file.write(table.numpy().astype("<f4", copy=False).tobytes())


def read_gaussian_ply(path: str | Path) -> GaussianPly:
    """Read a binary little-endian 3DGS PLY; other columns are skipped. Raises ModelFileError.

    Sizes are checked against the file before memory is allocated; numbers that are not finite are refused by place.
    """
    path = Path(path)
    table = read_ply_header(path)
    coefficients = _coefficients(path, table)
    wanted = [name for name in _column_names(coefficients) if name not in ("nx", "ny", "nz")]
    missing = [name for name in wanted if name not in (table.dtype.names or ())]
    if missing:
        raise ModelFileError(
            f"{path}: the PLY has no column '{missing[0]}', so it is not a 3-D Gaussian model; "
            "export one with 'ringlight export' or another 3DGS program"
        )
    values = _read_columns(path, table, wanted)
    _refuse_not_finite(path, wanted, values)
    means, sh_dc, rest, opacity, log_scales, quats = values.split([3, 3, 3 * coefficients, 1, 3, 4], 1)
    gaussians = Gaussians(
        means=means.contiguous(),
        log_scales=log_scales.contiguous(),
        quats=quats.contiguous(),
        opacity_logits=opacity[:, 0].contiguous(),
        appearance={
            "sh_dc": sh_dc.contiguous(),
            "sh_rest": rest.unflatten(1, (3, coefficients)).transpose(1, 2).contiguous(),
        },
    )
    return GaussianPly(gaussians, MIP_COMMENT in table.comments)


def _column_names(coefficients: int) -> list[str]:
    """All columns in file order, for K coefficients beyond the constant one."""
    names = ["x", "y", "z", "nx", "ny", "nz"]
    names += [f"f_dc_{i}" for i in range(3)]
    names += [f"f_rest_{i}" for i in range(3 * coefficients)]
    return names + ["opacity"] + [f"scale_{i}" for i in range(3)] + [f"rot_{i}" for i in range(4)]


def _coefficients(path: Path, table: PlyTable) -> int:
    count = sum(name.startswith("f_rest_") for name in table.dtype.names or ())
    if count not in REST_COUNTS:
        raise ModelFileError(
            f"{path}: the PLY has {count} f_rest columns, but spherical harmonics of degree 0 to 3 have 0, 9, 24 or "
            "45; export it again with one of these degrees"
        )
    return REST_COUNTS[count]


def _read_columns(path: Path, table: PlyTable, names: list[str]) -> Float[Tensor, "N c"]:
    values = np.empty((table.rows, len(names)), np.float32)
    with path.open("rb") as file:
        file.seek(table.begin)
        for begin in range(0, table.rows, CHUNK_ROWS):
            rows = np.fromfile(file, table.dtype, min(CHUNK_ROWS, table.rows - begin))
            if begin + len(rows) < min(begin + CHUNK_ROWS, table.rows):
                raise ModelFileError(f"{path}: the file shrank while it was read; copy it again")
            for column, name in enumerate(names):
                values[begin : begin + len(rows), column] = rows[name]
    return torch.from_numpy(values)


def _refuse_not_finite(path: Path, names: list[str], values: Float[Tensor, "N c"]) -> None:
    if values.isfinite().all():
        return
    broken = first_not_finite(dict(zip(names, values.unbind(1), strict=True)))
    raise ModelFileError(f"{path}: column {broken}, and only finite numbers can be drawn; export it again without them")
