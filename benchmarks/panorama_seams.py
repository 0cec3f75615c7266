"""How near a panorama is to pinhole pictures of the same place: ahead, and across the seam between two of its faces.

python benchmarks/panorama_seams.py RUN ...   # PSNR of 200 x 200 pixels, from each run's first training camera
"""

import math
import sys
from pathlib import Path

import torch
from jaxtyping import Float
from torch import Tensor

from ringlight.core.camera import Camera
from ringlight.core.want import Want
from ringlight.files.layer_pictures import COLOR, looking
from ringlight.files.rigs import Panorama
from ringlight.measure.metrics import psnr
from ringlight.runs.opened import open_model

WIDTH, SIDE = 2048, 200
TURNS = {"ahead": 0.0, "across the seam": 45.0}
"""Degrees to the right."""


def turned(camera: Camera, degrees: float) -> tuple[Camera, Float[Tensor, "3 3"]]:
    """A pinhole whose pixels are as large as the panorama's horizon's, and its turn."""
    sine, cosine = math.sin(math.radians(degrees)), math.cos(math.radians(degrees))
    turn = torch.tensor([[cosine, 0.0, -sine], [0.0, 1.0, 0.0], [sine, 0.0, cosine]])
    matrix = camera.world_to_camera.clone()
    matrix[:3] = turn @ matrix[:3]
    focal = WIDTH / (2 * math.pi)
    return Camera(matrix, (focal, focal), (SIDE / 2, SIDE / 2), SIDE, SIDE), turn


def cut_out(panorama: Float[Tensor, "H W 3"], pinhole: Camera, turn: Float[Tensor, "3 3"]) -> Float[Tensor, "S S 3"]:
    """What the panorama shows in the directions of the pinhole's pixels, linearly."""
    still = Camera(torch.eye(4), pinhole.focal, pinhole.center, pinhole.width, pinhole.height)
    directions = still.ray_directions() @ turn
    longitude = torch.atan2(directions[..., 0], directions[..., 2]) / math.pi
    latitude = torch.asin(directions[..., 1]) / (math.pi / 2)
    places = torch.stack([longitude, latitude], -1)[None]
    found = torch.nn.functional.grid_sample(panorama.permute(2, 0, 1)[None], places, align_corners=False)
    return found[0].permute(1, 2, 0)


def main() -> None:
    """One line a run."""
    for run in sys.argv[1:]:
        stored = open_model(Path(run)).stored
        camera = stored.cameras[0]
        look = looking(stored.model, torch.ones(3), (COLOR,), Want.EXACT)
        panorama = Panorama(WIDTH).see(look, camera)[COLOR]
        measured = []
        for name, degrees in TURNS.items():
            pinhole, turn = turned(camera, degrees)
            measured.append(f"{name} {psnr(cut_out(panorama, pinhole, turn), look(pinhole)[COLOR]):.1f} dB")
        sys.stdout.write(f"{run}: {', '.join(measured)}\n")


if __name__ == "__main__":
    main()
