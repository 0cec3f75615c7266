"""The loaders, each with small legal files of its kind. It may refuse a file by RinglightError and nothing else."""

import atexit
import contextlib
import dataclasses
import io
import json
import os
import shutil
import tempfile
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
import torch
from deep_png import deep_png
from heic_sample import HEIC
from PIL import Image, features
from samples import sample_report
from scene_folders import write_blender, write_colmap, write_nerfstudio

from ringlight.core.gaussians import Gaussians
from ringlight.core.scene import Scene
from ringlight.data import colmap_binary, colmap_text
from ringlight.data.image_files import BROKEN_IMAGE, PIXELS_A_BYTE, PIXELS_A_BYTE_OF, read_header
from ringlight.data.images import Photograph
from ringlight.data.load import load_scene
from ringlight.data.options import SceneOptions
from ringlight.data.ply_points import read_ply_points
from ringlight.data.true_normals import read_true_normals, refuse_turned_away, views_of
from ringlight.errors import RinglightError
from ringlight.files.ply import read_gaussian_ply, write_gaussian_ply
from ringlight.files.tensor_file import read_tensors, write_tensors
from ringlight.fit.train import Training, train
from ringlight.measure.json_record import to_json
from ringlight.measure.report import REPORT_NAME, read_report
from ringlight.methods.store import load_model, model_header, save_model, scene_facts
from ringlight.methods.table import METHODS
from ringlight.rasterize.choose import rasterizer_for
from ringlight.runs.checkpoints import read_checkpoint, refuse_misfits, write_checkpoint
from ringlight.runs.demo import PLAN_NAME, Demo
from ringlight.runs.folder import RunFolder
from ringlight.runs.opened import Opened, recorded_scene
from ringlight.runs.record import RECORD_NAME, RunRecord
from small_recipes import with_settings
from tiny_scene import tiny_scene
from true_normals_file import arrays_of

REFUSALS = RinglightError

HOME = Path(tempfile.mkdtemp(prefix="ringlight-fuzz-", dir="/dev/shm" if os.access("/dev/shm", os.W_OK) else None))
atexit.register(shutil.rmtree, HOME, ignore_errors=True)


@dataclass(frozen=True)
class Target:
    """``seeds`` are legal files by kind, ``large`` some of about a megabyte; ``load`` reads the bytes of one of that
    kind, and may raise RinglightError. ``justified`` are the bytes that a legal file which begins so may take."""

    seeds: list[tuple[int, bytes]]
    load: Callable[[int, bytes], object]
    large: list[tuple[int, bytes]] = field(default_factory=list)
    justified: Callable[[bytes], int] = lambda content: len(content)


def _reading(name: str, *readers: Callable[[Path], object]) -> Callable[[int, bytes], object]:
    path = HOME / name

    def load(kind: int, content: bytes) -> object:
        path.write_bytes(content)
        return readers[kind](path)

    return load


def _bytes(write: Callable[[Path], object]) -> bytes:
    path = HOME / "seed"
    write(path)
    return path.read_bytes()


def _without_checksum(content: bytes) -> bytes:
    """As another program writes it: mutations then reach what the checksum would have refused."""
    length = int.from_bytes(content[:8], "little")
    header = json.loads(content[8 : 8 + length])
    header["__metadata__"].pop("ringlight.checksum")
    encoded = json.dumps(header, separators=(",", ":")).encode()
    return len(encoded).to_bytes(8, "little") + encoded + content[8 + length :]


def gaussian_ply() -> Target:
    def table(path: Path, n: int, coefficients: int) -> None:
        geometry = Gaussians(torch.rand(n, 3), torch.rand(n, 3), torch.rand(n, 4), torch.rand(n))
        write_gaussian_ply(path, geometry, torch.rand(n, 3), torch.rand(n, coefficients, 3))

    seeds, large = ([(0, _bytes(lambda path, n=n, k=k: table(path, n, k))) for k in (0, 3)] for n in (5, 20_000))
    return Target(seeds, _reading("gaussians.ply", read_gaussian_ply), large)


def ply_points() -> Target:
    columns = b"property float x\nproperty float y\nproperty float z\nproperty uchar red\nproperty uchar green\n"
    rest = columns + b"property uchar blue\nend_header\n"
    header, many = b"element vertex 3\n" + rest, b"element vertex 30000\n" + rest
    ascii_rows = b"0.5 1 2 255 0 9\n-1 -2e3 3 1 2 3\n4 5 6 7 8 9\n"
    binary = b"".join(np.array([i, 2, -3], "<f4").tobytes() + bytes([i, 2, 3]) for i in range(3))
    seeds = [
        b"ply\nformat ascii 1.0\n" + header + ascii_rows,
        b"ply\nformat binary_little_endian 1.0\n" + header + binary,
    ]
    large = [
        b"ply\nformat ascii 1.0\n" + many + ascii_rows * 10_000,
        b"ply\nformat binary_little_endian 1.0\n" + many + binary * 10_000,
    ]
    load = _reading("points.ply", read_ply_points)
    return Target([(0, seed) for seed in seeds], load, [(0, seed) for seed in large])


def tensor_file() -> Target:
    tensors = {"a": torch.rand(3, 2), "b": torch.arange(3), "c": torch.rand(2).half(), "d": torch.tensor([True])}
    whole = _bytes(lambda path: write_tensors(path, tensors, {"note": "x", "other": "y"}))
    many = _bytes(lambda path: write_tensors(path, {"a": torch.rand(100_000, 3), "b": torch.arange(100_000)}, {}))
    large = [(0, many), (0, _without_checksum(many))]
    return Target([(0, whole), (0, _without_checksum(whole))], _reading("tensors.safetensors", read_tensors), large)


def _recipe(method: str) -> Any:
    """With the smallest tensors: a mutation then hits what is said of them more often than what is in them."""
    if method == "tensorf":
        factors = {"density_components": 16, "appearance_components": 16, "features": 3, "hidden": 4}
        return with_settings(METHODS[method], {"first_side": 3, "last_side": 4, "rays": 8, **factors})
    ring = {"rank": 2, "features": 2, "head_hidden": 4, "position_nodes": 8, "view_nodes": 4}
    return with_settings(METHODS[method], {"light": {"ring": ring, "render_hidden": 4, "modulation_hidden": 4}})


def _training(method: str) -> Training:
    scene = tiny_scene(views=2, size=8)
    scene = dataclasses.replace(scene, points=type(scene.points)(scene.points.positions[:6], scene.points.colors[:6]))
    training: Training = _recipe(method).build(scene, rasterizer_for("auto"), 0)
    return training


def _model(path: Path, method: str) -> None:
    training = _training(method)
    scene = training.batches.scene
    header = model_header(method, _recipe(method), 3, scene_facts(scene, SceneOptions()))
    save_model(path, training.model, header, [view.camera for view in scene.train])


def model() -> Target:
    return _models("3dgs", "ringlight-basis", "ringlight-ring")


def volume() -> Target:
    return _models("tensorf", "putt")


def _models(*methods: str) -> Target:
    rasterize = rasterizer_for("auto")

    def open_and_draw(path: Path) -> None:
        stored = load_model(path, rasterize)
        if stored.cameras:
            with torch.no_grad():
                stored.model.render(stored.cameras[0].resized(8, 8), torch.ones(3))
        recorded_scene(Opened(path, None, stored))

    wholes = [_bytes(lambda path, m=m: _model(path, m)) for m in methods]
    seeds = [(0, wholes[0]), *((0, _without_checksum(whole)) for whole in wholes)]
    return Target(seeds, _reading("model.safetensors", open_and_draw))


def checkpoint() -> Target:
    return _checkpoints("3dgs")


def volume_checkpoint() -> Target:
    return _checkpoints("tensorf")


def train_checkpoint() -> Target:
    return _checkpoints("putt")


def _checkpoints(method: str) -> Target:
    training = _training(method)
    next(train(training))  # what the first step brings is kept too
    own = {name: tensor.clone() for name, tensor in training.state().items()}
    fresh = _training(method)
    folder = RunFolder(HOME / f"run-{method}")
    folder.path.mkdir(exist_ok=True)
    facts = {
        "wall_seconds": "1.5",
        "cpu_seconds": "1.5",
        "saving_seconds": "0.5",
        "peak_bytes": "0",
        "training_views": "2",
    }
    write_checkpoint(folder, own, facts)
    whole = folder.checkpoint.read_bytes()

    def restore(kind: int, content: bytes) -> None:
        folder.checkpoint.write_bytes(content)
        stored = read_checkpoint(folder)[0] if kind == 0 else read_tensors(folder.checkpoint)
        with contextlib.suppress(KeyError, RuntimeError, ValueError):  # as resume_run
            refuse_misfits(stored.tensors, fresh)
            training.restore(stored.tensors)

    return Target([(0, whole), (1, _without_checksum(whole))], restore)


def recipe() -> Target:
    seeds = []
    for method in ("3dgs", "ringlight-basis", "ringlight-ring", "tensorf", "putt"):
        RunRecord(method, METHODS[method], Path("scene"), SceneOptions(), 0, "auto", "0.1").write(HOME)
        seeds.append((0, (HOME / RECORD_NAME).read_bytes()))
    return Target(seeds, _reading(RECORD_NAME, lambda path: RunRecord.read(path.parent)))


def demo_plan() -> Target:
    seed = json.dumps({"scene": "toaster", "steps": 7000, "seed": 0}).encode()
    return Target([(0, seed)], _reading(PLAN_NAME, lambda path: Demo.open(path.parent)))


def report() -> Target:
    few, many = (to_json(sample_report(images=sample_report().images * n)).encode() for n in (1, 5000))
    return Target([(0, few)], _reading(REPORT_NAME, lambda path: read_report(path.parent)), [(0, many)])


def colmap() -> Target:
    seeds: list[tuple[int, bytes]] = []
    readers: list[Callable[[Path], object]] = []
    for text, module in ((False, colmap_binary), (True, colmap_text)):
        folder = write_colmap(HOME / f"colmap-{text}", count=3, text=text) / "sparse" / "0"
        suffix = "txt" if text else "bin"
        for name, reader in (("cameras", "read_cameras"), ("images", "read_images"), ("points3D", "read_points")):
            seeds.append((len(readers), (folder / f"{name}.{suffix}").read_bytes()))
            readers.append(getattr(module, reader))
    return Target(seeds, _reading("colmap", *readers))


def scene_json() -> Target:
    blender, nerfstudio = write_blender(HOME / "blender", train=2, test=1), write_nerfstudio(HOME / "ns", count=3)
    files = [blender / "transforms_train.json", nerfstudio / "transforms.json"]
    options = SceneOptions(initial_points=10)
    seeds = [(kind, file.read_bytes()) for kind, file in enumerate(files)]

    def load(kind: int, content: bytes) -> object:
        files[kind].write_bytes(content)
        return load_scene(files[kind].parent, options)

    return Target(seeds, load)


def image() -> Target:
    pixels = np.random.default_rng(0).integers(0, 256, (9, 11, 4), dtype=np.uint8)
    many = np.tile(pixels, (50, 50, 1))
    seeds: list[tuple[int, bytes]] = []
    large: list[tuple[int, bytes]] = []
    for kind, mode in (
        ("PNG", "RGBA"),
        ("JPEG", "RGB"),
        ("WEBP", "RGB"),
        ("BMP", "RGB"),
        ("TIFF", "RGB"),
        ("PNG", "P"),
    ):
        for image, files in ((pixels, seeds), (many, large)):
            buffer = io.BytesIO()
            Image.fromarray(image).convert(mode).save(buffer, kind)
            files.append((0, buffer.getvalue()))

    if features.check("avif"):
        buffer = io.BytesIO()
        Image.fromarray(pixels).save(buffer, "AVIF")
        seeds.append((0, buffer.getvalue()))
    seeds += [(0, HEIC), (0, deep_png(pixels.astype(np.uint16) * 257)), (0, deep_png(pixels[..., :1] * np.uint16(200)))]

    def decode(path: Path) -> None:
        header = read_header(path)
        Photograph(path, min(header.width, 16), min(header.height, 16))()

    def four_bytes_a_pixel(content: bytes) -> int:
        """A picture of one colour has few bytes and all its pixels: what its head says, up to what is believed.

        Decoders work on blocks of 16 pixels: of a picture nine pixels high they have seven more rows.
        """
        try:
            picture = Image.open(io.BytesIO(content))
        except BROKEN_IMAGE:
            return len(content)
        width, height = (-(-side // 16) * 16 for side in picture.size)
        most = PIXELS_A_BYTE_OF.get(picture.format or "", PIXELS_A_BYTE)
        return 4 * min(width * height, most * len(content))

    return Target(seeds, _reading("photograph", decode), large, four_bytes_a_pixel)


def true_normals() -> Target:
    small, large = (tiny_scene(views=4, size=size) for size in (6, 300))

    def read(path: Path) -> None:
        truth = read_true_normals(path)
        views = views_of(truth, large if truth.width == 300 else small)
        for view, normals in zip(views, truth.views(), strict=True):
            refuse_turned_away(normals, view, truth)

    def content(save: Callable[..., None], scene: Scene) -> tuple[int, bytes]:
        buffer = io.BytesIO()
        save(buffer, **arrays_of(scene))
        return 0, buffer.getvalue()

    seeds, many = ([content(save, scene) for save in (np.savez, np.savez_compressed)] for scene in (small, large))
    return Target(seeds, _reading("truth.npz", read), many)


TARGETS: dict[str, Callable[[], Target]] = {
    maker.__name__: maker
    for maker in (
        gaussian_ply, ply_points, tensor_file, model, volume, checkpoint, volume_checkpoint, train_checkpoint, recipe,
        demo_plan, report, colmap, scene_json, image, true_normals,
    )
}  # fmt: skip
