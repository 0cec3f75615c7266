"""What ``ringlight render`` can be asked for."""

from dataclasses import dataclass
from typing import Annotated, Literal

import tyro

from ringlight.cli.arguments import Device, MaybeFolder, ModelPath
from ringlight.errors import RecipeError
from ringlight.files.frame_rate import FASTEST, SLOWEST

Layer = Literal["color", "base", "residual", "modulation", "normal", "depth", "alpha"]


@dataclass(frozen=True)
class RenderArguments:
    """Pictures of a trained model: its test views, an orbit, or a flight through training cameras or key frames.

    Writes FOLDER/LAYER/NAME.png and prints FOLDER; with --video also FOLDER/LAYER.mp4. Layers are those of the paper's
    figures 8 and 9: base colour, view-dependent residual (signed, around grey) and light modulation. There are also
    world normals, depth (near is light) and alpha.
    """

    model: ModelPath
    """Run folder or model file."""
    path: Annotated[str, tyro.conf.arg(metavar="{test,train,orbit,interpolated}|FILE.json")] = "test"
    """Where the camera goes. FILE.json holds key frames (docs/render.md), or is a camera_path.json of nerfstudio, in
    the scene's own world, or beside nerfstudio's dataparser_transforms.json in the one that it trained in. Only test
    needs photographs besides the model file."""
    scene: MaybeFolder = None
    """Folder of photographs with the test views, and with the training cameras that a path goes by, or toaster or
    carpaint, which are bundled; by default the model's own."""
    frames: int | None = None
    """Number of pictures. By default 120 for orbit and interpolated, all test or training views, and of key frames as
    many as their seconds take."""
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
    format: Literal["png", "png16", "exr", "npy"] = "png"
    """png: pictures for the eye. The others hold numbers: png16 in 16 bits, exr (needs the [exr] extra) and npy in 32;
    cameras.json beside them tells units, frames and each picture's camera."""
    stereo: Annotated[str | None, tyro.conf.arg(metavar="BASELINE|auto")] = None
    """Two pictures side by side, the left eye's left; the eyes are BASELINE world units apart, or as auto a thirtieth
    of the distance of the nearest surface."""
    panorama: bool = False
    """Pictures of all directions, equirectangular, --width pixels wide and half as high; the middle is what the camera
    looks at."""
    out: MaybeFolder = None
    """New folder for the pictures; by default RUN/renders/PATH, or PATH-2, ... where that exists."""
    overwrite: bool = False
    """Write into --out even if it holds something. Only pictures of the same name are replaced."""
    video: bool = False
    """Also make an mp4 of each layer; needs the [video] extra."""
    fps: float | None = None
    """Frames a second of the mp4. By default 30, or what FILE.json says."""
    width: int | None = None
    """Width of the pictures, pixels, of each eye's; by default as trained, 2048 of a panorama."""
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
    json: bool = False
    """Print what was written as JSON: folder, folders and films of the layers, size, and names of the frames."""
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
        if self.fps is not None and not SLOWEST <= self.fps <= FASTEST:
            raise RecipeError(f"--fps is {self.fps:g}: give {SLOWEST:g} to {FASTEST:g} frames a second")
        if not self.layers:
            raise RecipeError("--layers names nothing; give at least one, such as color")
        if self.video and self.format != "png":
            raise RecipeError(f"--video is made of pictures for the eye, not of {self.format}; leave out --format")
        if self.panorama and (self.stereo is not None or self.zoom is not None):
            other = "--stereo" if self.stereo is not None else "--zoom"
            raise RecipeError(f"--panorama shows all directions from one place; leave out {other}")
        self._refuse_idle()
        self.baseline()  # refused before anything is read
        if self.path != "orbit" and (given := [f"--{name}" for name in OF_ORBITS if getattr(self, name) is not None]):
            raise RecipeError(f"{given[0]} is of an orbit; give --path orbit with it")
        if self.path in PATHS:
            self.refuse_fps()

    def _refuse_idle(self) -> None:
        """Raise RecipeError for a flag that another makes idle, or that wants another."""
        if self.width is not None and self.scale is not None:
            raise RecipeError("--width and --scale both say how large; give one of them")
        if self.overwrite and self.out is None:
            raise RecipeError("--overwrite is of a folder that is named, and another is new; give --out FOLDER with it")

    def refuse_fps(self) -> None:
        """Raise RecipeError for --fps without a film. Not asked of key frames, which take more pictures by it."""
        if self.fps is not None and not self.video:
            raise RecipeError("--fps is of a film; give --video with it")

    def baseline(self) -> float | None:
        """World units between the eyes; None where they are left open, or there is one eye."""
        if self.stereo in (None, AUTO):
            return None
        try:
            baseline = float(self.stereo)
        except ValueError:
            baseline = 0.0
        if not 0 < baseline < float("inf"):
            raise RecipeError(f"--stereo is {self.stereo}: give world units above zero, or {AUTO}")
        return baseline


AUTO = "auto"

PANORAMA_WIDTH = 2048
"""Pixels."""

WIDEST_PANORAMA = 11_312
"""Pixels: as many as the largest picture has, 64 millions."""

PATHS = ("test", "train", "orbit", "interpolated")

OF_ORBITS = ("center", "radius", "height", "arc")

FPS = 30.0

FRAMES = 120
"""Four seconds at 30 frames a second."""

MOST_FRAMES = 108_000
"""An hour of these: their cameras are all made before the first picture, and take memory."""
