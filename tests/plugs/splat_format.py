"""A plug: the .splat file of antimatter15's viewer, 32 bytes a Gaussian, colours from one side only.

Centre 3 and scales 3 in float32, colour and opacity 4 in bytes, quaternion wxyz 4 in bytes; the largest and most opaque
first, which is the order in which that viewer loads.
"""

from pathlib import Path

import torch

from ringlight.core.gaussians import Gaussians
from ringlight.core.sh_basis import rgb_from_sh
from ringlight.files.atomic import written_atomically
from ringlight.files.formats.contract import Content, Form

BYTES_EACH = 32


class SplatFile:
    """See :class:`ringlight.files.formats.contract.Writer`; colours lose their view dependence."""

    form = Form.HARMONICS
    about = "antimatter15's viewer in a browser"

    def write(self, path: Path, content: Content) -> None:
        table = Gaussians.from_columns(content.tensors)
        table = table.rows((-(table.log_scales.sum(-1).exp() * table.opacities)).argsort())
        color = rgb_from_sh(table.appearance["sh_dc"]).clamp(0, 1)
        quats = torch.nn.functional.normalize(table.quats, dim=-1)
        floats = torch.cat([table.means, table.scales], -1).float().contiguous().view(torch.uint8)
        eight_bit = torch.cat([color, table.opacities[:, None]], -1).mul(255).round().to(torch.uint8)
        turned = (quats * 128 + 128).round().clamp(0, 255).to(torch.uint8)
        with written_atomically(path) as file:
            file.write(torch.cat([floats, eight_bit, turned], -1).numpy().tobytes())
