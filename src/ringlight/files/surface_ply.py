"""A PLY file of coloured triangles, or of their corners alone, as programs for meshes and point clouds read it."""

from collections.abc import Sequence
from pathlib import Path

import numpy as np
import torch
from jaxtyping import Float, Int
from torch import Tensor

from ringlight.files.atomic import written_atomically

CORNER = np.dtype([("at", "<f4", 3), ("normal", "<f4", 3), ("color", "u1", 3)])
TRIANGLE = np.dtype([("count", "u1"), ("corners", "<i4", 3)])


def write_surface_ply(
    path: Path,
    corners: Float[Tensor, "V 3"],
    normals: Float[Tensor, "V 3"],
    colors: Float[Tensor, "V 3"],
    triangles: Int[Tensor, "T 3"] | None,
    comments: Sequence[str] = (),
) -> None:
    """Write all or nothing; colours in [0, 1] become 8 bit; points alone without ``triangles``. Raises OutputError."""
    rows = np.zeros(len(corners), CORNER)
    rows["at"], rows["normal"] = corners.numpy(), normals.numpy()
    rows["color"] = (255 * colors.clamp(0, 1)).round().to(torch.uint8).numpy()
    header = ["ply", "format binary_little_endian 1.0"]
    # A line break would end the comment and corrupt the header.
    header += [f"comment {' '.join(comment.split())}" for comment in comments]
    header += [f"element vertex {len(rows)}"]
    header += [f"property float {name}" for name in ("x", "y", "z", "nx", "ny", "nz")]
    header += [f"property uchar {name}" for name in ("red", "green", "blue")]
    faces = np.zeros(0 if triangles is None else len(triangles), TRIANGLE)
    if triangles is not None:
        faces["count"], faces["corners"] = 3, triangles.numpy()
        header += [f"element face {len(faces)}", "property list uchar int vertex_indices"]
    with written_atomically(path) as file:
        file.write("\n".join([*header, "end_header", ""]).encode("ascii", "backslashreplace"))
        file.write(rows.tobytes())
        file.write(faces.tobytes())
