"""COLMAP in a process of its own: ``python -m ringlight.poses.worker``, an order in, progress and a result out.

pycolmap 4.2.1 brings a zlib of its own: in a process that loads it before Pillow, Pillow crashes when it writes a PNG.
It also ends the process where it finds a bug, and prints to standard error. So nothing else imports it, and this module
imports nothing that compresses. The order is one line of JSON on standard input, which the parent keeps open: when it
closes, the parent is gone, and this process ends. Standard output gets lines of JSON: ``{"done", "total"}`` and at last
``{"result"}``. What COLMAP prints goes to standard error.
"""

import json
import os
import shutil
import sys
import threading
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

from ringlight.poses.upright import find_up, rotation_to_z

Tell = Callable[[int, int], None]

PAIRS_AT_ONCE = 100
"""Pairs between two lines of progress, all kept by COLMAP once compared."""

MAPPING_THREADS = 1
"""Ceres adds up in the order in which threads get done: with more, no two runs give the same bits."""

FEWEST_REGISTERED = 3
"""Photographs of a model; two say nothing that a third confirms."""

ERRORS_ONLY = 2
"""glog's level: warnings of COLMAP tell a person nothing."""


def seek_features(order: dict[str, Any], tell: Tell) -> None:
    """SIFT of the photographs in ``order["groups"]``, each group through one lens; what the database has is kept."""
    import pycolmap

    options = pycolmap.FeatureExtractionOptions()
    options.use_gpu, options.num_threads = False, order["threads"]
    options.max_image_size, options.sift.max_num_features = order["feature_size"], order["features"]
    done, total = 0, sum(len(group["names"]) for group in order["groups"])
    at_once = max(4, 2 * (order["threads"] if order["threads"] > 0 else os.cpu_count() or 1))
    for group in order["groups"]:
        reader = _enrol(order["database"], group)
        for start in range(0, len(group["names"]), at_once):
            names = group["names"][start : start + at_once]
            pycolmap.extract_features(
                order["database"],
                group["images"],
                image_names=names,
                camera_mode=pycolmap.CameraMode.SINGLE,
                reader_options=reader,
                extraction_options=options,
            )
            done += len(names)
            tell(done, total)


def _enrol(database_path: str, group: dict[str, Any]) -> Any:
    """Give the photographs of a group their numbers, in order and through one lens; returns how they are read.

    Left to the threads that seek features, the numbers would be given in the order in which they get done.
    """
    import pycolmap

    with pycolmap.Database.open(database_path) as database:
        known = {image.name: image.camera_id for image in database.read_all_images()}
    reader = pycolmap.ImageReaderOptions()
    reader.camera_model = group["model"]
    reader.existing_camera_id = _camera_of(known, group["lens_of"])
    new = [name for name in group["names"] if name not in known]
    if new:
        pycolmap.import_images(database_path, group["images"], pycolmap.CameraMode.SINGLE, new, reader)
        with pycolmap.Database.open(database_path) as database:
            known = {image.name: image.camera_id for image in database.read_all_images()}
        reader.existing_camera_id = _camera_of(known, group["lens_of"])
    if group["masks"]:
        reader.mask_path = group["masks"]
    return reader


def _camera_of(known: dict[str, int], names: list[str]) -> int:
    """The lens of the first of these photographs that is known; -1 if none is."""
    return next((known[name] for name in names if name in known), -1)


def compare_pairs(order: dict[str, Any], tell: Tell) -> None:
    """Match and verify the pairs of names in ``order["pairs"]``, whose names hold no blanks."""
    import pycolmap

    matching, verifying = pycolmap.FeatureMatchingOptions(), pycolmap.TwoViewGeometryOptions()
    matching.use_gpu, matching.num_threads = False, order["threads"]
    verifying.ransac.random_seed = order["seed"]
    listed = Path(order["scratch"]) / "pairs.txt"
    pairs = order["pairs"]
    for start in range(0, len(pairs), PAIRS_AT_ONCE):
        block = pairs[start : start + PAIRS_AT_ONCE]
        listed.write_text("".join(f"{one} {other}\n" for one, other in block), encoding="utf-8")
        pairing = pycolmap.ImportedPairingOptions()
        pairing.match_list_path = str(listed)
        pycolmap.set_random_seed(order["seed"])
        pycolmap.match_image_pairs(
            order["database"], matching_options=matching, pairing_options=pairing, verification_options=verifying
        )
        tell(start + len(block), len(pairs))


def map_photographs(order: dict[str, Any], tell: Tell) -> dict[str, Any]:
    """Solve for the cameras, turn the largest model upright, and write it to ``order["model"]``."""
    models: list[Any] = []
    used, tried = order["mappers"][0], []
    for mapper in order["mappers"]:
        scratch = Path(order["scratch"]) / mapper
        shutil.rmtree(scratch, ignore_errors=True)
        scratch.mkdir(parents=True)
        found = sorted(_map(mapper, order, scratch, tell), key=lambda model: -model.num_reg_images())
        tried.append({"mapper": mapper, "models": [model.num_reg_images() for model in found]})
        if found and (not models or found[0].num_reg_images() > models[0].num_reg_images()):
            models, used = found, mapper
        if models and models[0].num_reg_images() == order["photographs"]:
            break
    if not models:
        return {"mapper": used, "tried": tried, "models": []}
    up = _turn_upright(models[0], order["orientations"])
    folder = Path(order["model"])
    folder.mkdir(parents=True, exist_ok=True)
    models[0].write_binary(str(folder))
    return {"mapper": used, "tried": tried, "models": [_names(model) for model in models], "up": up} | _facts(models[0])


def _map(mapper: str, order: dict[str, Any], scratch: Path, tell: Tell) -> list[Any]:
    import pycolmap

    pycolmap.set_random_seed(order["seed"])
    if mapper == "global":
        own = scratch / "database.db"  # calibration writes to it
        shutil.copyfile(order["database"], own)
        pycolmap.calibrate_view_graph(str(own))
        many = pycolmap.GlobalPipelineOptions()
        many.random_seed, many.num_threads, many.min_model_size = order["seed"], MAPPING_THREADS, FEWEST_REGISTERED
        found = pycolmap.global_mapping(str(own), order["images"], str(scratch), many)
        return [model for model in found.values() if model.num_reg_images() >= FEWEST_REGISTERED]
    options = pycolmap.IncrementalPipelineOptions()
    options.random_seed, options.num_threads = order["seed"], MAPPING_THREADS
    options.min_model_size = FEWEST_REGISTERED
    placed = [2]

    def count() -> None:
        placed[0] = min(placed[0] + 1, order["photographs"])
        tell(placed[0], order["photographs"])

    found = pycolmap.incremental_mapping(
        order["database"], order["images"], str(scratch), options, next_image_callback=count
    )
    return [model for model in found.values() if model.num_reg_images() >= FEWEST_REGISTERED]


def _turn_upright(model: Any, orientations: dict[str, int]) -> str:
    """Up becomes +z, the middle of the points the origin; returns the reason."""
    import pycolmap

    images = [model.image(number) for number in sorted(model.reg_image_ids())]
    rotations = np.stack([image.cam_from_world().rotation.matrix() for image in images])
    centers = np.stack([image.projection_center() for image in images])
    up = find_up(rotations, centers, [orientations.get(image.name, 1) for image in images])
    turn = rotation_to_z(up.direction)
    points = np.array([point.xyz for point in model.points3D.values()]).reshape(-1, 3)
    middle = turn @ np.median(points if len(points) else centers, axis=0)
    model.transform(pycolmap.Sim3d(1.0, pycolmap.Rotation3d(turn), -middle))
    return up.reason


def _names(model: Any) -> list[str]:
    return sorted(model.image(number).name for number in model.reg_image_ids())


def _facts(model: Any) -> dict[str, Any]:
    lenses = [
        {"model": camera.model.name, "width": camera.width, "height": camera.height, "parameters": list(camera.params)}
        for _, camera in sorted(model.cameras.items())
    ]
    return {
        "reprojection_error": model.compute_mean_reprojection_error(),
        "points": model.num_points3D(),
        "track_length": model.compute_mean_track_length(),
        "lenses": lenses,
    }


TASKS: dict[str, Callable[[dict[str, Any], Tell], Any]] = {
    "features": seek_features,
    "matches": compare_pairs,
    "mapping": map_photographs,
}


def _end_with_parent() -> None:
    while os.read(0, 1):
        pass
    os._exit(1)


def main() -> None:
    """Read the order, do it, write the result."""
    order = json.loads(_first_line())
    threading.Thread(target=_end_with_parent, daemon=True).start()
    told = os.fdopen(os.dup(1), "w", encoding="utf-8")
    os.dup2(2, 1)  # what COLMAP prints is no message
    import pycolmap

    pycolmap.logging.minloglevel = ERRORS_ONLY

    def say(message: dict[str, Any]) -> None:
        told.write(json.dumps(message) + "\n")
        told.flush()

    result = TASKS[order["task"]](order, lambda done, total: say({"done": done, "total": total}))
    say({"result": result})
    sys.stderr.flush()
    os._exit(0)  # past the thread that waits for the parent


def _first_line() -> bytes:
    """Not through Python's buffer, which would take what the waiting thread looks for."""
    line = bytearray()
    while not line.endswith(b"\n"):
        piece = os.read(0, 1 << 16)
        if not piece:
            os._exit(1)
        line += piece
    return bytes(line)


if __name__ == "__main__":
    main()
