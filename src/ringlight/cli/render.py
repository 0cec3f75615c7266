"""``ringlight render MODEL``: pictures and films of a trained model."""

import sys
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Literal

from ringlight.cli.arguments import Device, MaybeFolder, ModelPath
from ringlight.cli.gpu_build import tell_of_build
from ringlight.cli.parse import parse
from ringlight.data.options import SceneOptions
from ringlight.errors import RecipeError

if TYPE_CHECKING:
    from torch import Tensor

    from ringlight.runs.film import Film
    from ringlight.runs.opened import Opened

Layer = Literal["color", "base", "residual", "modulation", "normal", "depth", "alpha"]


@dataclass(frozen=True)
class RenderArguments:
    """Pictures of a trained model: its test views, an orbit, or a flight through the training cameras.

    Writes FOLDER/LAYER/NAME.png and prints FOLDER; with --video also FOLDER/LAYER.mp4. Layers are those of the paper's
    figures 8 and 9: base colour, view-dependent residual (signed, around grey) and light modulation. There are also
    world normals, depth (near is light) and alpha.
    """

    model: ModelPath
    """Run folder or model file."""
    path: Literal["test", "train", "orbit", "interpolated"] = "test"
    """Where the camera goes. Only test needs photographs besides the model file."""
    scene: MaybeFolder = None
    """Folder of photographs with the test views; by default the model's own."""
    frames: int | None = None
    """Number of pictures. By default 120 for orbit and interpolated, and all test or training views."""
    layers: tuple[Layer, ...] = ("color",)
    """What to show."""
    out: MaybeFolder = None
    """New folder for the pictures; by default RUN/renders/PATH, or PATH-2, ... where that exists."""
    overwrite: bool = False
    """Write into --out even if it holds something. Only pictures of the same name are replaced."""
    video: bool = False
    """Also make an mp4 of each layer; needs the [video] extra."""
    fps: float = 30.0
    """Frames a second of the mp4."""
    width: int | None = None
    """Width of the pictures, pixels; by default as trained."""
    scale: float | None = None
    """Factor on width and height, in place of --width."""
    zoom: float = 1.0
    """Factor on the focal length. 0.7 shows a subject whole that an orbit cuts at the picture's edge."""
    background: Literal["auto", "white", "black"] = "auto"
    """What lies behind the Gaussians. auto is as trained."""
    device: Device = "auto"
    """Rasterizer: auto is the fastest that this machine has."""
    threads: int = 0
    """Threads of the kernels; 0 takes every core."""
    quiet: bool = False
    """No progress line."""

    def __post_init__(self) -> None:
        for name in ("frames", "width", "scale", "zoom", "fps"):
            value = getattr(self, name)
            if value is not None and not 0 < value < float("inf"):
                raise RecipeError(f"--{name} is {value}: give a number above zero")
        if self.frames is not None and self.frames > MOST_FRAMES:
            raise RecipeError(
                f"--frames is {self.frames}: give at most {MOST_FRAMES}, an hour of film, and join several"
            )
        if not self.layers:
            raise RecipeError("--layers names nothing; give at least one, such as color")


FRAMES = 120
"""Four seconds at 30 frames a second."""

MOST_FRAMES = 108_000
"""An hour of these: their cameras are all made before the first picture, and take memory."""


def main(arguments: list[str]) -> int:
    """Render; returns the exit code."""
    asked = parse(RenderArguments, "render", arguments)
    from ringlight.cli.counting import counting
    from ringlight.cli.threads import use_threads
    from ringlight.files.layer_pictures import check_layers
    from ringlight.files.video import video_library
    from ringlight.runs.film import film_to_video, render_film
    from ringlight.runs.opened import open_model

    if asked.video:
        video_library()
    use_threads(asked.threads)
    tell_of_build(asked.device)
    opened = open_model(asked.model, asked.device)
    film = _film(asked, opened)
    layers = tuple(dict.fromkeys(asked.layers))
    check_layers(opened.stored.model, film.cameras[0], layers)
    folder = _folder(asked, opened)
    with counting(f"{opened.file}: {asked.path}", asked.quiet) as tell:
        written = render_film(opened.stored.model, film, _background(asked, opened), layers, folder, tell)
    for pictures in written if asked.video else ():
        with counting(f"{pictures.name}.mp4", asked.quiet) as tell:
            film_to_video(pictures, film.names, asked.fps, tell)
    if not asked.quiet:
        size = f"{film.cameras[0].width}x{film.cameras[0].height}"
        kinds = "  ".join(f"{layer}{'  ' + layer + '.mp4' if asked.video else ''}" for layer in layers)
        sys.stderr.write(f"{len(film.cameras)} frame{'s' * (len(film.cameras) != 1)} of {size}: {kinds}\n")
    sys.stdout.write(f"{folder}\n")
    return 0


def _film(asked: RenderArguments, opened: "Opened") -> "Film":
    from ringlight.runs.film import film_from_training, film_of_views
    from ringlight.runs.opened import scene_of

    if asked.path == "test":
        film = film_of_views(scene_of(opened, asked.scene, SceneOptions()))
    else:
        film = film_from_training(opened, asked.path, asked.frames or FRAMES)
    return film.thinned(asked.frames or len(film.cameras)).zoomed(asked.zoom).resized(asked.width, asked.scale)


def _background(asked: RenderArguments, opened: "Opened") -> "Tensor":
    import torch

    name = opened.stored.header.scene.background if asked.background == "auto" else asked.background
    return torch.zeros(3) if name == "black" else torch.ones(3)


def _folder(asked: RenderArguments, opened: "Opened") -> Path:
    """The folder to write to. Raises RunError if it holds anything, unless that was agreed to."""
    from ringlight.runs.folder import empty_folder, free_folder, make_folder

    if asked.out is None:
        return make_folder(free_folder(opened.file.parent / "renders" / asked.path))
    return make_folder(asked.out) if asked.overwrite else empty_folder(asked.out)
