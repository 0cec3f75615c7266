"""``ringlight render MODEL``: pictures and films of a trained model."""

import sys
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal, get_args

import tyro

from ringlight.cli.arguments import Device, MaybeFolder, ModelPath
from ringlight.cli.flags import behind_values
from ringlight.cli.gpu_build import tell_of_build
from ringlight.cli.main import is_out_of_memory
from ringlight.cli.parse import parse, refuse
from ringlight.cli.stages import StageLine, stages
from ringlight.cli.threads import check_threads, use_threads
from ringlight.core.command_line import command
from ringlight.core.words import counted
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
    path: Annotated[str, tyro.conf.arg(metavar="{test,train,orbit,interpolated}|FILE.json")] = "test"
    """Where the camera goes; FILE.json is a camera_path.json of nerfstudio, in the scene's own world, or beside
    nerfstudio's dataparser_transforms.json in the one that it trained in. Only test needs photographs
    besides the model file."""
    scene: MaybeFolder = None
    """Folder of photographs with the test views, and with the training cameras that a path goes by; by default the
    model's own."""
    frames: int | None = None
    """Number of pictures. By default 120 for orbit and interpolated, and all test or training views."""
    center: tuple[float, float, float] | None = None
    """What an orbit looks at: x, y and z in the world's units. By default where most cameras looked."""
    radius: float | None = None
    """Of an orbit, in the world's units. By default the cameras' median."""
    height: float | None = None
    """Of an orbit above its centre, in the world's units. By default the cameras' median."""
    arc: float | None = None
    """Degrees of an orbit. By default what was photographed: 360, or an arc on which the camera swings."""
    layers: tuple[Layer, ...] = ("color",)
    """What to show."""
    out: MaybeFolder = None
    """New folder for the pictures; by default RUN/renders/PATH, or PATH-2, ... where that exists."""
    overwrite: bool = False
    """Write into --out even if it holds something. Only pictures of the same name are replaced."""
    video: bool = False
    """Also make an mp4 of each layer; needs the [video] extra."""
    fps: float | None = None
    """Frames a second of the mp4. By default 30, or what FILE.json says."""
    width: int | None = None
    """Width of the pictures, pixels; by default as trained."""
    scale: float | None = None
    """Factor on width and height, in place of --width."""
    zoom: float | None = None
    """Factor on the focal length. By default 1; an orbit zooms out until a subject that masks cut out is whole."""
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
                raise RecipeError(f"--{name} is {value}: give a {'finite ' if value > 0 else ''}number above zero")
        if self.frames is not None and self.frames > MOST_FRAMES:
            raise RecipeError(
                f"--frames is {self.frames}: give at most {MOST_FRAMES}, an hour of film, and join several"
            )
        if not self.layers:
            raise RecipeError("--layers names nothing; give at least one, such as color")

        if self.path != "orbit" and (given := [f"--{name}" for name in OF_ORBITS if getattr(self, name) is not None]):
            raise RecipeError(f"{given[0]} is of an orbit; give --path orbit with it")


PATHS = ("test", "train", "orbit", "interpolated")

OF_ORBITS = ("center", "radius", "height", "arc")

FPS = 30.0

FRAMES = 120
"""Four seconds at 30 frames a second."""

MOST_FRAMES = 108_000
"""An hour of these: their cameras are all made before the first picture, and take memory."""


def main(arguments: list[str]) -> int:
    """Render; returns the exit code."""
    asked = parse(RenderArguments, "render", behind_values(arguments, "--layers", get_args(Layer)))
    _refuse_unknown_path(asked.path)
    check_threads(asked.threads)
    with stages(asked.quiet) as line:
        line(f"reading {asked.model}")
        return _render(asked, line)


def _render(asked: RenderArguments, line: StageLine) -> int:
    from ringlight.files.layer_pictures import known_layers
    from ringlight.files.video import video_library
    from ringlight.runs.film import film_to_video, render_film
    from ringlight.runs.opened import open_model

    if asked.video:
        video_library()
    use_threads(asked.threads)
    tell_of_build(asked.device)
    opened = open_model(asked.model, asked.device)
    film, taken, fps = _film(asked, opened)
    layers, lacking = known_layers(opened.stored.model, film.cameras[0], tuple(dict.fromkeys(asked.layers)))
    if lacking:
        sys.stderr.write(f"warning: this model has no layer {' or '.join(lacking)}; left out\n")
    folder = _folder(asked, opened)
    tell = partial(line, "drawing pictures")
    with _fitting_memory(film):
        written = render_film(opened.stored.model, film, _background(asked, opened), layers, folder, tell)
    for pictures in written if asked.video else ():
        film_to_video(pictures, film.names, fps, partial(line, f"writing {pictures.name}.mp4"))
    line.wiped()
    if not asked.quiet:
        size = f"{film.cameras[0].width}x{film.cameras[0].height}"
        kinds = "  ".join(f"{layer}{'  ' + layer + '.mp4' if asked.video else ''}" for layer in layers)
        sys.stderr.write(f"{counted(len(film.cameras), 'frame')} of {size}: {kinds}\n{taken}")
    sys.stdout.write(f"{folder}\n")
    return 0


@contextmanager
def _fitting_memory(film: "Film") -> Iterator[None]:
    """Memory that is short inside the block has the remedy of pictures."""
    try:
        yield
    except (MemoryError, RuntimeError) as error:
        if not is_out_of_memory(error):
            raise
        size = f"{film.cameras[0].width}x{film.cameras[0].height}"
        remedy = "close other programs, or give a smaller --width or --scale"
        raise RecipeError(f"not enough memory for pictures of {size}; {remedy}") from error


def _refuse_unknown_path(path: str) -> None:
    if path not in PATHS and not path.lower().endswith(".json"):
        refuse("render", f"--path is {path!r}: expected one of {', '.join(PATHS)}, or a file that ends in .json")


def _film(asked: RenderArguments, opened: "Opened") -> "tuple[Film, str, float]":
    """The cameras, a line on what was chosen, and frames a second."""
    from ringlight.files.nerfstudio_frame import FRAME_NAME, UNMOVED
    from ringlight.files.nerfstudio_path import read_nerfstudio_path
    from ringlight.files.orbit import OrbitWish
    from ringlight.runs.film import film_from_training, film_of_file, film_of_orbit, film_of_views
    from ringlight.runs.nerfstudio_world import scene_was_moved
    from ringlight.runs.opened import scene_of, with_cameras_of

    fps, frames, taken = asked.fps or FPS, asked.frames or FRAMES, ""
    if asked.scene is not None and asked.path in PATHS and asked.path != "test":
        opened = with_cameras_of(opened, asked.scene)
    if asked.path == "orbit":
        wish = OrbitWish(asked.center, asked.radius, asked.height, asked.arc)
        film, words = film_of_orbit(opened, wish, frames, asked.zoom)
        return film.resized(asked.width, asked.scale), f"the orbit is: {words}\n", fps
    if asked.path == "test":
        again = command("render", asked.model, "--scene", "FOLDER")
        again += "; --path orbit needs no photographs" if opened.stored.cameras else ""
        film = film_of_views(scene_of(opened, asked.scene, SceneOptions(), again))
    elif asked.path in PATHS:
        film = film_from_training(opened, asked.path, frames)
    else:
        again = command("render", asked.model, "--path", asked.path, "--scene", "FOLDER")
        moved = scene_was_moved(Path(asked.path), opened, asked.scene, again)
        read = read_nerfstudio_path(Path(asked.path), MOST_FRAMES, moved)
        film, fps = film_of_file(read), asked.fps or read.fps or FPS
        if moved is not UNMOVED:
            taken = f"cameras brought back into the scene's world by {Path(asked.path).with_name(FRAME_NAME)}\n"
    film = film.thinned(asked.frames or len(film.cameras)).zoomed(asked.zoom or 1.0)
    return film.resized(asked.width, asked.scale), taken, fps


def _background(asked: RenderArguments, opened: "Opened") -> "Tensor":
    import torch

    name = opened.stored.header.scene.background if asked.background == "auto" else asked.background
    return torch.zeros(3) if name == "black" else torch.ones(3)


def _folder(asked: RenderArguments, opened: "Opened") -> Path:
    """The folder to write to. Raises RunError if it holds anything, unless that was agreed to."""
    from ringlight.runs.folder import empty_folder, free_folder, make_folder

    if asked.out is None:
        name = asked.path if asked.path in PATHS else Path(asked.path).stem
        return make_folder(free_folder(opened.file.parent / "renders" / name))
    return make_folder(asked.out) if asked.overwrite else empty_folder(asked.out)
