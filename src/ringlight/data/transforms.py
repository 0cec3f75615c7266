"""Frames of a transforms file: what NeRF-Synthetic, nerfstudio and instant-ngp have in common.

A value that a frame does not state is the file's, but for other focal lengths where it states one. Poses are
camera-to-world with OpenGL axes.
"""

import math
from pathlib import Path

from ringlight.core.stages import counted
from ringlight.data.folder import image_inside, require_none_missing, shown
from ringlight.data.frame import Frame, NamedMask
from ringlight.data.image_files import ImageHeader, read_header
from ringlight.data.intrinsics import COEFFICIENTS, Intrinsics, checked_intrinsics, checked_lens
from ringlight.data.json_fields import Fields, number, pose_matrix, text
from ringlight.data.lens import Lens
from ringlight.data.poses import camera_of, world_to_camera_from_opengl
from ringlight.data.undistort import undistortion_of
from ringlight.errors import SceneError

PERSPECTIVE_MODELS = frozenset(
    {"PINHOLE", "SIMPLE_PINHOLE", "SIMPLE_RADIAL", "RADIAL", "OPENCV", "FULL_OPENCV", "PERSPECTIVE"}
)
"""Values of ``camera_model`` that are a pinhole once their coefficients are zero; as in nerfstudio each of them may
have all that OPENCV has, whatever its name."""

FISHEYE_MODELS = frozenset({"OPENCV_FISHEYE", "RADIAL_FISHEYE", "SIMPLE_RADIAL_FISHEYE", "FISHEYE", "SIMPLE_FISHEYE"})
"""Values of ``camera_model`` that project by angle."""

FOCALS = ("fl_x", "fl_y", "camera_angle_x", "camera_angle_y")
"""What says how long a lens is: of these one that is left out follows from another."""

LISTED = ("k1", "k2", "k3", "k4", "p1", "p2")
"""Order of nerfstudio's ``distortion_params``."""

DIVISOR = ("k4", "k5", "k6")
"""Coefficients of a perspective lens that only FULL_OPENCV defines."""

OTHER_PROJECTIONS = ("ftheta_p0", "latlong", "equirectangular", "orthographic", "omega")
"""Keys by which instant-ngp announces a lens that is not one of OpenCV's."""


def read_frames(document: Fields, file: Path, may_be_none: bool = False) -> list[Frame]:
    """All frames of a transforms file, in its order, at the size of the image files.

    Raises:
        SceneError: no frames, unless there ``may_be_none``, an image that is missing, unreadable or outside the
            folder, a pose or lens that cannot be used.
    """
    entries = document.get("frames")
    if not isinstance(entries, list) or not (entries or may_be_none):
        raise SceneError(f"{file}: lists no frames; export the cameras again")
    base, missing, frames = file.parent, [], []
    for index, entry in enumerate(counted("looking at photographs", entries)):
        where = f"{file}: frame {index}"
        name = text(entry, "file_path", where) if isinstance(entry, dict) else None
        if name is None:
            raise SceneError(f"{where} names no image under 'file_path'; export the cameras again")
        path = image_inside(base, name, where)
        if path is None:
            missing.append((where, name))
        elif not missing:  # once an image is missing the scene is refused: only the others are still counted
            frames.append(_frame(_fields_of(entry, document), path, base, f"{where} ({shown(name)})"))
    require_none_missing(missing, len(entries), base)
    return frames


def _fields_of(entry: Fields, document: Fields) -> Fields:
    """A frame's own values, and the file's where it has none; of an own focal length or angle all of the file's."""
    hidden = FOCALS if any(entry.get(name) is not None for name in FOCALS) else ()
    return {name: value for name, value in document.items() if name not in hidden} | dict(entry)


def _frame(fields: Fields, path: Path, base: Path, where: str) -> Frame:
    header = read_header(path)
    pose = world_to_camera_from_opengl(pose_matrix(fields, where), where)
    photographed = read_intrinsics(fields, header, where)
    undistortion = undistortion_of(photographed, where)
    camera = camera_of(pose, undistortion.pinhole if undistortion else photographed)
    name = path.relative_to(base.resolve()).as_posix()
    return Frame(name, path, camera, header, undistortion=undistortion, named_mask=_mask(fields, base, where))


def _mask(fields: Fields, base: Path, where: str) -> NamedMask | None:
    """nerfstudio's ``mask_path``, null where the frame has none."""
    name = None if fields.get("mask_path") is None else text(fields, "mask_path", where)
    return None if name is None else NamedMask(base, name, where)


def read_intrinsics(fields: Fields, header: ImageHeader, where: str) -> Intrinsics:
    """Focal lengths from ``fl_x``, ``fl_y`` or ``camera_angle_x``, ``_y`` (radians), in pixels of the image file.

    ``fl_x``, ``cx`` and the like are in pixels of ``w`` by ``h``, which default to the image's own size; what is
    given for one axis holds for the other (square pixels); the centre defaults to the middle.

    Raises:
        SceneError: no focal length, a lens that cannot be undistorted, unusable numbers.
    """
    lens = read_lens(fields, where)
    width = number(fields, "w", where, float(header.width))
    height = number(fields, "h", where, float(header.height))
    focal_x, focal_y = _focal(fields, "x", width, where), _focal(fields, "y", height, where)
    either = focal_x if focal_x is not None else focal_y
    if either is None:
        raise SceneError(f"{where} has neither 'fl_x' nor 'camera_angle_x'; export the cameras with a focal length")
    focal = (either if focal_x is None else focal_x, either if focal_y is None else focal_y)
    center = (number(fields, "cx", where, width / 2), number(fields, "cy", where, height / 2))
    camera = checked_intrinsics(focal, center, (width, height), where, lens)
    return camera.on_image(header.width, header.height, where)


def _focal(fields: Fields, axis: str, side: float, where: str) -> float | None:
    focal = number(fields, f"fl_{axis}", where, None)
    angle = number(fields, f"camera_angle_{axis}", where, None)
    if focal is not None or angle is None:
        return focal
    if not 0 < angle < math.pi:
        raise SceneError(f"{where} has a field of view of {angle:g} radians; correct 'camera_angle_{axis}'")
    return 0.5 * side / math.tan(0.5 * angle)


def _listed_coefficients(fields: Fields, where: str) -> Fields:
    """nerfstudio's ``distortion_params``, one list instead of names. Raises SceneError where it is no such list, or
    names stand beside it."""
    listed = fields.get("distortion_params")
    if listed is None:
        return {}
    if not isinstance(listed, list) or len(listed) > len(LISTED):
        orders = ", ".join(LISTED)
        raise SceneError(
            f"{where} has 'distortion_params' {shown(str(listed))}; give up to {len(LISTED)} numbers: {orders}"
        )
    named = [name for name in COEFFICIENTS if fields.get(name)]
    if named:
        raise SceneError(f"{where} has 'distortion_params' and {named[0]!r}, of which one is enough; remove one")
    return dict(zip(LISTED, listed, strict=False))


def read_lens(fields: Fields, where: str) -> Lens:
    """The lens by ``camera_model`` (nerfstudio) or ``is_fisheye`` (instant-ngp) and the coefficients k1 to k6, p1, p2,
    or nerfstudio's list of them.

    Raises:
        SceneError: another projection, or coefficients that programs read differently.
    """
    remedy = "undistort the images first (colmap image_undistorter) and train on its output"
    stated = text(fields, "camera_model", where)
    fisheye = bool(fields.get("is_fisheye"))
    model = stated.upper() if stated else "OPENCV_FISHEYE" if fisheye else "OPENCV"
    if model not in PERSPECTIVE_MODELS | FISHEYE_MODELS:
        raise SceneError(
            f"{where} has the camera model {shown(stated or model)}, which cannot be undistorted here; {remedy}"
        )
    projection = next((key for key in OTHER_PROJECTIONS if fields.get(key)), None)
    if projection is not None:
        raise SceneError(f"{where} has a lens that cannot be undistorted here ({projection!r}); {remedy}")
    if fisheye and model in PERSPECTIVE_MODELS:
        raise SceneError(f"{where} has 'is_fisheye' and the camera model {stated!r}, of which one is wrong; remove it")
    fields = {**fields, **_listed_coefficients(fields, where)}
    given = {name: value for name in COEFFICIENTS if (value := number(fields, name, where, 0.0))}
    unclear = [name for name in DIVISOR if name in given]
    if unclear and model in PERSPECTIVE_MODELS - {"FULL_OPENCV"}:
        raise SceneError(
            f"{where} has {' and '.join(unclear)} in a lens that is no fisheye, which programs read differently; state "
            "'camera_model' FULL_OPENCV if they are OpenCV's"
        )
    name = "OPENCV" if "PINHOLE" in model or model == "PERSPECTIVE" else model
    return checked_lens(name, model in FISHEYE_MODELS, given, where)
