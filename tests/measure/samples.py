"""A report and pictures to test with."""

from typing import Any

import torch

from ringlight.measure.machine import Machine
from ringlight.measure.report import ImageScore, Report

MACHINE = Machine("A CPU", 2, 2, "avx2", None, "Linux x86_64", "3.11.7", "2.13.0")
NO_LPIPS = "LPIPS is unavailable; get its weights with 'ringlight fetch-lpips'."


def sample_report(**changes: Any) -> Report:
    """A complete report of 3dgs on toaster_200, with the given fields changed."""
    fields: dict[str, Any] = dict(
        method="3dgs",
        preset="3dgs",
        version="0.1.0",
        commit=None,
        seed=0,
        dataset="blender",
        scene="toaster_200",
        split="official files",
        resolution="200x200",
        background="white",
        notes=("images as they are",),
        iterations=3000,
        planned=3000,
        psnr=22.134,
        psnr_u8=22.131,
        psnr_pooled=21.9,
        ssim_same=0.8801,
        ssim_valid=0.8702,
        lpips_alex=None,
        lpips_vgg=None,
        lpips_vgg_01=None,
        lpips_note=NO_LPIPS,
        counted=28_123,
        noun="Gaussians",
        bytes_raw=6_640_000,
        bytes_by_part={"columns.means": 337_476, "columns.sh": 6_302_524},
        bytes_file=6_700_000,
        train_seconds=13.4,
        train_cpu_seconds=25.0,
        saving_seconds=0.2,
        peak_bytes=250_000_000,
        training_bytes={"parameters": 600, "moments": 1200},
        steps_per_second=222.4,
        fps=180.2,
        fps_note="render call only",
        machine=MACHINE,
        images=(ImageScore("r_0", 22.0, 22.0, 0.88, 0.87),),
    )
    return Report(**(fields | changes))


def picture(height: int = 20, width: int = 30, seed: int = 0) -> torch.Tensor:
    """Random pixels in [0, 1], on the grid of 8 bit."""
    generator = torch.Generator().manual_seed(seed)
    return torch.randint(0, 256, (height, width, 3), generator=generator).float() / 255
