"""Frames of a transforms file: what NeRF-Synthetic, nerfstudio and instant-ngp have in common.

A value that a frame does not state holds for the whole file. Poses are camera-to-world with OpenGL axes.
"""

import math
from pathlib import Path

from ringlight.data.folder import image_inside, require_none_missing, shown
from ringlight.data.frame import Frame
from ringlight.data.image_files import ImageHeader, read_header
from ringlight.data.intrinsics import Intrinsics, checked_intrinsics
from ringlight.data.json_fields import Fields, number, pose_matrix, text
from ringlight.data.mask_files import MaskFile
from ringlight.data.poses import camera_of, world_to_camera_from_opengl
from ringlight.errors import SceneError

DISTORTION = ("k1", "k2", "k3", "k4", "k5", "k6", "p1", "p2", "omega")
"""Lens coefficients that nerfstudio and instant-ngp write; a pinhole has none."""

PERSPECTIVE_MODELS = frozenset(
    {"PINHOLE", "SIMPLE_PINHOLE", "SIMPLE_RADIAL", "RADIAL", "OPENCV", "FULL_OPENCV", "PERSPECTIVE"}
)
"""Values of ``camera_model`` that are a pinhole once their coefficients are zero; a fisheye lens never is."""

OTHER_PROJECTIONS = ("is_fisheye", "ftheta_p0", "latlong", "equirectangular", "orthographic")
"""Keys by which instant-ngp announces a lens that is not a pinhole."""


def read_frames(document: Fields, file: Path) -> list[Frame]:
    """All frames of a transforms file, in its order, at the size of the image files.

    Raises:
        SceneError: no frames, an image that is missing, unreadable or outside the folder, a pose or lens that
            cannot be used.
    """
    entries = document.get("frames")
    if not isinstance(entries, list) or not entries:
        raise SceneError(f"{file}: lists no frames; export the cameras again")
    base, missing, frames = file.parent, [], []
    for index, entry in enumerate(entries):
        where = f"{file}: frame {index}"
        name = text(entry, "file_path", where) if isinstance(entry, dict) else None
        if name is None:
            raise SceneError(f"{where} names no image under 'file_path'; export the cameras again")
        path = image_inside(base, name, where)
        if path is None:
            missing.append((where, name))
        elif not missing:  # once an image is missing the scene is refused: only the others are still counted
            frames.append(_frame({**document, **entry}, path, base, f"{where} ({shown(name)})"))
    require_none_missing(missing, len(entries), base)
    return frames


def _frame(fields: Fields, path: Path, base: Path, where: str) -> Frame:
    header = read_header(path)
    pose = world_to_camera_from_opengl(pose_matrix(fields, where), where)
    camera = camera_of(pose, read_intrinsics(fields, header, where))
    name = path.relative_to(base.resolve()).as_posix()
    return Frame(name, path, camera, header, _mask(fields, base, where))


def _mask(fields: Fields, base: Path, where: str) -> MaskFile | None:
    """nerfstudio's ``mask_path``; a file that is missing is refused where masks are wanted."""
    name = text(fields, "mask_path", where)
    return None if name is None else MaskFile(image_inside(base, name, where) or base / name)


def read_intrinsics(fields: Fields, header: ImageHeader, where: str) -> Intrinsics:
    """Focal lengths from ``fl_x``, ``fl_y`` or ``camera_angle_x``, ``_y`` (radians), in pixels of the image file.

    ``fl_x``, ``cx`` and the like are in pixels of ``w`` by ``h``, which default to the image's own size; what is
    given for one axis holds for the other (square pixels); the centre defaults to the middle.

    Raises:
        SceneError: no focal length, a lens with distortion or another projection, unusable numbers.
    """
    _require_pinhole(fields, where)
    width = number(fields, "w", where, float(header.width))
    height = number(fields, "h", where, float(header.height))
    focal_x, focal_y = _focal(fields, "x", width, where), _focal(fields, "y", height, where)
    either = focal_x if focal_x is not None else focal_y
    if either is None:
        raise SceneError(f"{where} has neither 'fl_x' nor 'camera_angle_x'; export the cameras with a focal length")
    focal = (either if focal_x is None else focal_x, either if focal_y is None else focal_y)
    center = (number(fields, "cx", where, width / 2), number(fields, "cy", where, height / 2))
    return checked_intrinsics(focal, center, (width, height), where).on_image(header.width, header.height, where)


def _focal(fields: Fields, axis: str, side: float, where: str) -> float | None:
    focal = number(fields, f"fl_{axis}", where, None)
    angle = number(fields, f"camera_angle_{axis}", where, None)
    if focal is not None or angle is None:
        return focal
    if not 0 < angle < math.pi:
        raise SceneError(f"{where} has a field of view of {angle:g} radians; correct 'camera_angle_{axis}'")
    return 0.5 * side / math.tan(0.5 * angle)


def _require_pinhole(fields: Fields, where: str) -> None:
    """Refuse lenses that bend rays: the rasterizers project through a pinhole."""
    remedy = "undistort the images first (colmap image_undistorter) and train on its output"
    model = text(fields, "camera_model", where)
    if model is not None and model.upper() not in PERSPECTIVE_MODELS:
        raise SceneError(f"{where} has the camera model {shown(model)}, which is not a pinhole; {remedy}")
    projection = next((key for key in OTHER_PROJECTIONS if fields.get(key)), None)
    if projection is not None:
        raise SceneError(f"{where} has a lens that is not a pinhole ({projection!r}); {remedy}")
    bent = [name for name in DISTORTION if number(fields, name, where, None)]
    if bent:
        raise SceneError(f"{where} has a lens with distortion ({', '.join(bent)} not zero); {remedy}")
