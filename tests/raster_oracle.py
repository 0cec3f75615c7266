"""Images and gradients of gsplat's own float64 reference, as calls of a rasterizer."""

from dataclasses import dataclass

import numpy as np
import torch
from torch import Tensor

from ringlight.core.camera import Camera
from ringlight.core.gaussians import Gaussians
from ringlight.rasterize import convention
from ringlight.rasterize.contract import RasterOptions
from shared_data import shared

ORACLES = (
    "classic_153",
    "classic_153_small",
    "classic_160",
    "antialiased_153",
    "rgbd_153",
    "feat16_153",
    "near_153",
)


@dataclass
class Oracle:
    """One file: its arrays, and the call that must reproduce them."""

    arrays: dict[str, Tensor]
    leaves: dict[str, Tensor]
    camera: Camera
    channels: Tensor
    background: Tensor
    options: RasterOptions

    @property
    def cotangents(self) -> list[Tensor]:
        """Upstream gradients of image [H W C] and alpha [H W 1]."""
        dtype = self.channels.dtype
        return [self.arrays["in_v_img"].to(dtype), self.arrays["in_v_alpha"][..., None].to(dtype)]

    @property
    def gaussians(self) -> Gaussians:
        leaf = self.leaves
        return Gaussians(leaf["means"], leaf["scales"].log(), leaf["quats"], leaf["opacities"].logit())


def load_oracle(name: str, dtype: torch.dtype = torch.float64) -> Oracle:
    """Inputs as leaves of ``dtype``; skips the calling test where the shared data is missing."""
    with np.load(shared(f"oracle/{name}.npz")) as file:
        arrays = {key: torch.from_numpy(np.asarray(file[key])) for key in file.files}
    names = ("means", "scales", "quats", "opacities", "colors", "viewmat")
    leaves = {key: arrays[f"in_{key}"].to(dtype).requires_grad_() for key in names}
    (fx, _, cx), (_, fy, cy) = arrays["in_K"].double()[:2].tolist()
    camera = Camera(leaves["viewmat"], (fx, fy), (cx, cy), int(arrays["in_W"]), int(arrays["in_H"]))
    channels, background = leaves["colors"], arrays["in_background"].to(dtype)
    if name.startswith("rgbd"):
        # This file was rendered without a background.
        depths = leaves["means"] @ leaves["viewmat"][2, :3] + leaves["viewmat"][2, 3]
        channels, background = torch.cat([channels, depths[:, None]], 1), torch.zeros(4, dtype=dtype)
    max_alpha = 0.99 if name.endswith("160") else convention.MAX_ALPHA
    options = RasterOptions(max_alpha=max_alpha, antialiased=name.startswith("antialiased"), absgrad=True)
    return Oracle(arrays, leaves, camera, channels, background, options)
