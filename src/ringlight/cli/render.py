"""``ringlight render MODEL``: pictures and films of a trained model."""

import sys
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, get_args

from ringlight.cli.flags import behind_values
from ringlight.cli.gpu_build import tell_of_build
from ringlight.cli.main import is_out_of_memory
from ringlight.cli.parse import parse, refuse
from ringlight.cli.render_arguments import (
    FPS,
    FRAMES,
    MOST_FRAMES,
    PANORAMA_WIDTH,
    PATHS,
    WIDEST_PANORAMA,
    Layer,
    RenderArguments,
)
from ringlight.cli.stages import StageLine, stages
from ringlight.cli.threads import check_threads, use_threads
from ringlight.cli.unfinished import tell_unfinished
from ringlight.core.command_line import command
from ringlight.core.words import counted
from ringlight.data.options import SceneOptions
from ringlight.errors import RecipeError

if TYPE_CHECKING:
    from torch import Tensor

    from ringlight.files.rigs import Rig
    from ringlight.runs.film import Film
    from ringlight.runs.opened import Opened


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
    from ringlight.files.number_files import exr_library
    from ringlight.files.video import video_library
    from ringlight.runs.film_pictures import film_to_video, render_film, render_numbers
    from ringlight.runs.opened import open_model

    if asked.video:
        video_library()
    if asked.format == "exr":
        exr_library()
    use_threads(asked.threads)
    tell_of_build(asked.device)
    opened = open_model(asked.model, asked.device)
    tell_unfinished(opened, asked.quiet)
    film, taken, fps = _film(asked, opened)
    layers, lacking = known_layers(opened.stored.model, film.cameras[0], tuple(dict.fromkeys(asked.layers)))
    if lacking:
        sys.stderr.write(f"warning: this model has no layer {' or '.join(lacking)}; left out\n")
    with _fitting_memory(film):
        rig, of_rig = _rig(asked, opened, film)
    folder = _folder(asked, opened)
    tell = partial(line, "drawing pictures")
    what = opened.stored.model, film, _background(asked, opened), layers, folder, tell, rig
    too_deep, written = 0, []
    with _fitting_memory(film):
        if asked.format == "png":
            written = render_film(*what)
        else:
            too_deep = render_numbers(*what, asked.format)
    if too_deep:
        sys.stderr.write(f"warning: {counted(too_deep, 'pixel')} deeper than png16 holds have the largest value\n")
    for pictures in written if asked.video else ():
        film_to_video(pictures, film.names, fps, partial(line, f"writing {pictures.name}.mp4"))
    line.wiped()
    if not asked.quiet:
        size = "{}x{}".format(*rig.size(film.cameras[0]))
        kinds = "  ".join(f"{layer}{'  ' + layer + '.mp4' if asked.video else ''}" for layer in layers)
        sys.stderr.write(f"{counted(len(film.cameras), 'frame')} of {size}: {kinds}\n{taken}{of_rig}")
    if asked.json:
        sys.stdout.write(_record(folder, film, layers, rig.size(film.cameras[0]), asked))
    else:
        sys.stdout.write(f"{folder}\n")
    return 0


def _record(folder: Path, film: "Film", layers: Sequence[str], size: tuple[int, int], asked: RenderArguments) -> str:
    """What was written, as JSON: of each layer its folder, which holds all the frames, and its film."""
    from ringlight.files.number_files import SUFFIXES
    from ringlight.measure.json_record import to_json

    return to_json(
        {
            "folder": str(folder),
            "layers": {layer: str(folder / layer) for layer in layers},
            "films": {layer: str(folder / f"{layer}.mp4") for layer in layers if asked.video},
            "width": size[0],
            "height": size[1],
            "frames": [str(Path(name).with_suffix(SUFFIXES[asked.format])) for name in film.names],
        }
    )


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


def _rig(asked: RenderArguments, opened: "Opened", film: "Film") -> "tuple[Rig, str]":
    """What stands at the cameras' places, and a line on what was chosen for it."""
    from ringlight.files.rigs import Panorama, Pinhole
    from ringlight.runs.film_pictures import stereo_rig

    if asked.panorama:
        width = asked.width or round(PANORAMA_WIDTH * (asked.scale or 1.0))
        if not 2 <= width <= WIDEST_PANORAMA or width % 2:
            raise RecipeError(
                f"a panorama of {width} pixels cannot be made; give an even --width, 2 to {WIDEST_PANORAMA}"
            )
        return Panorama(width), ""
    if asked.stereo is None:
        return Pinhole(), ""
    rig = stereo_rig(opened, film, asked.baseline())
    return rig, f"the eyes are: --stereo {rig.baseline:.4g}\n"


def _refuse_unknown_path(path: str) -> None:
    if path not in PATHS and not path.lower().endswith(".json"):
        refuse("render", f"--path is {path!r}: expected one of {', '.join(PATHS)}, or a file that ends in .json")


def _film(asked: RenderArguments, opened: "Opened") -> "tuple[Film, str, float]":
    """The cameras, a line on what was chosen, and frames a second."""
    from ringlight.files.key_frames import holds_key_frames
    from ringlight.files.nerfstudio_frame import FRAME_NAME, UNMOVED
    from ringlight.files.nerfstudio_path import read_nerfstudio_path
    from ringlight.files.orbit import OrbitWish
    from ringlight.runs.film import (
        film_from_training,
        film_of_file,
        film_of_key_frames,
        film_of_orbit,
        film_of_views,
    )
    from ringlight.runs.nerfstudio_world import scene_was_moved
    from ringlight.runs.opened import scene_of, with_cameras_of

    fps, frames, taken = asked.fps or FPS, asked.frames or FRAMES, ""
    key_frames = asked.path not in PATHS and Path(asked.path).is_file() and holds_key_frames(Path(asked.path))
    if asked.scene is not None and (key_frames or (asked.path in PATHS and asked.path != "test")):
        opened = with_cameras_of(opened, asked.scene)
    if asked.path == "orbit":
        wish = OrbitWish(asked.center, asked.radius, asked.height, asked.arc)
        film, words = film_of_orbit(opened, wish, frames, asked.zoom)
        return _sized(asked, film), f"the orbit is: {words}\n", fps
    if key_frames:
        film, fps = film_of_key_frames(opened, Path(asked.path), asked.frames, asked.fps, MOST_FRAMES)
        return _sized(asked, film.zoomed(asked.zoom or 1.0)), taken, fps
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
        asked.refuse_fps()
        film, fps = film_of_file(read), asked.fps or read.fps or FPS
        if moved is not UNMOVED:
            taken = f"cameras brought back into the scene's world by {Path(asked.path).with_name(FRAME_NAME)}\n"
    if asked.frames is not None and asked.frames > len(film.cameras):
        taken += f"--frames asks for {asked.frames}: there are {len(film.cameras)}\n"
    film = film.thinned(asked.frames or len(film.cameras)).zoomed(asked.zoom or 1.0)
    return _sized(asked, film), taken, fps


def _sized(asked: RenderArguments, film: "Film") -> "Film":
    """As large as asked; the size of a panorama is its own."""
    return film if asked.panorama else film.resized(asked.width, asked.scale)


def _background(asked: RenderArguments, opened: "Opened") -> "Tensor":
    import torch

    name = opened.stored.header.scene.background if asked.background == "auto" else asked.background
    return torch.zeros(3) if name == "black" else torch.ones(3)


def _folder(asked: RenderArguments, opened: "Opened") -> Path:
    """The folder to write to. Raises RunError if it holds anything, unless that was agreed to."""
    from ringlight.runs.folder import empty_folder, make_folder, make_free_folder

    if asked.out is None:
        name = asked.path if asked.path in PATHS else Path(asked.path).stem
        return make_free_folder(opened.file.parent / "renders" / name)
    return make_folder(asked.out) if asked.overwrite else empty_folder(asked.out, or_else="--overwrite")
