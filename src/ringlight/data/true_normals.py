"""True normals of a scene's views, from an NPZ file; docs/normals.md defines the format."""

from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path, PurePosixPath

import numpy as np
from jaxtyping import Float

from ringlight.core.scene import Scene, View
from ringlight.core.words import counted
from ringlight.data.npz import REMEDY, Array, opened_array, opened_npz, texts
from ringlight.errors import SceneError

NORMALS, NAMES = "normals", "names"

UNIT = 32767
"""What a length of 1 is stored as."""

LENGTH_ERROR = 0.02
"""By how much a stored normal's length may differ from 1. Sixteen bits give 0.0001, normals that were half floats
before 0.001; normals in other units or with another meaning are far beyond."""

MOST_AWAY = 0.5
"""Share of a view's normals that may point away from its camera. Interpolated ones do so at silhouettes; where most do,
they are turned round, or not in world axes."""

MOST_NAME_BYTES = 1 << 22
"""All names together, as they are stored: those of 10,000 views with 100 characters each."""

DEFINED = "see docs/normals.md"


@dataclass(frozen=True)
class TrueNormals:
    """What the file says before a normal is read; ``names`` are those of the views, each once."""

    path: Path
    names: tuple[str, ...]
    width: int
    height: int

    def views(self) -> Iterator[Float[np.ndarray, "H W 3"]]:
        """World normals of each view in turn, float64, of unit length within :data:`LENGTH_ERROR`; zero where nothing
        is hit. One view is in memory at a time. Raises SceneError."""
        with opened_npz(self.path) as archive, opened_array(archive, NORMALS) as array:
            if array.shape != (len(self.names), self.height, self.width, 3):
                raise ValueError("it was changed while it was read")
            for name in self.names:
                yield self._view(array, name)
            array.refuse_rest()

    def _view(self, array: Array, name: str) -> Float[np.ndarray, "H W 3"]:
        shape = (self.height, self.width, 3)
        content = array.read(self.height * self.width * 3 * np.dtype(array.type).itemsize)
        normals = np.frombuffer(content, array.type).reshape(shape) / UNIT
        lengths = np.linalg.norm(normals, axis=-1)
        wrong = (lengths != 0) & (abs(lengths - 1) > LENGTH_ERROR)
        if wrong.any():
            pixels = counted(int(wrong.sum()), "normal")
            what = f"{pixels} of {name!r} have another length than 1, which is stored as {UNIT}"
            raise SceneError(f"{self.path}: {what}; {DEFINED}")
        return normals


def read_true_normals(path: Path) -> TrueNormals:
    """Names and sizes; the normals themselves stay on disk.

    Raises:
        SceneError: no such file, no NPZ file, arrays that lack or have another type or shape, names that occur twice.
    """
    with opened_npz(path) as archive:
        with opened_array(archive, NORMALS) as normals:
            kind, shape = normals.type, normals.shape
        if kind[1:] != "i2" or len(shape) != 4 or shape[-1] != 3:
            expected = "int16 [views, height, width, 3]"
            raise SceneError(f"{path}: 'normals' are {_said(kind, shape)}, not {expected}; {DEFINED}")
        with opened_array(archive, NAMES) as stored:
            if stored.type[1] != "U" or stored.shape != shape[:1]:
                said = _said(stored.type, stored.shape)
                raise SceneError(f"{path}: 'names' are {said}, not {shape[0]} texts; {DEFINED}")
            if shape[0] * int(stored.type[2:]) * 4 > MOST_NAME_BYTES:
                raise SceneError(f"{path}: its names take more than {MOST_NAME_BYTES} bytes; {REMEDY}")
            names = tuple(texts(stored))
    if not names:
        raise SceneError(f"{path}: holds no view; {REMEDY}")
    commonest, times = Counter(names).most_common(1)[0]
    if times > 1:
        raise SceneError(f"{path}: {times} views are called {commonest!r}; give each its own name")
    return TrueNormals(path, names, shape[2], shape[1])


def views_of(truth: TrueNormals, scene: Scene) -> list[View]:
    """The scene's test views that the file's names mean, in its order: a view's whole name, that without its suffix, or
    the last part of either.

    Raises:
        SceneError: a name that no test view has, or several have; a view of another size than the normals.
    """
    if not scene.test:
        raise SceneError(f"{scene.source}: has no test views; read it with a split that holds some out")
    by_name: dict[str, list[View]] = {}
    for view in scene.test:
        for name in _called(view.name):
            by_name.setdefault(name, []).append(view)
    return [_view_called(name, by_name.get(name, []), truth, scene) for name in truth.names]


def _called(name: str) -> set[str]:
    path = PurePosixPath(name)
    return {name, str(path.with_suffix("")) if path.name else name, path.name, path.stem}


def _view_called(name: str, found: Sequence[View], truth: TrueNormals, scene: Scene) -> View:
    if not found:
        like = f"whose names are like {scene.test[0].name!r}"
        raise SceneError(f"{truth.path}: {scene.source} has no test view {name!r}; give the scene, {like}, by --scene")
    if len(found) > 1:
        names = ", ".join(repr(view.name) for view in found[:2])
        raise SceneError(f"{truth.path}: {name!r} may be any of {names}; write the whole name of the view")
    camera = found[0].camera
    if (camera.width, camera.height) != (truth.width, truth.height):
        sizes = f"has {truth.width}x{truth.height} normals, and the camera {camera.width}x{camera.height} pixels"
        raise SceneError(f"{truth.path}: {name!r} {sizes}; make normals of the camera's size")
    return found[0]


def refuse_turned_away(normals: Float[np.ndarray, "H W 3"], view: View, truth: TrueNormals) -> None:
    """Raise SceneError where most normals point away from the camera that sees them."""
    there = normals.any(-1)
    away = (normals * view.camera.ray_directions().numpy()).sum(-1) > 0
    if (away & there).sum() > MOST_AWAY * there.sum():
        what = f"most normals of {view.name!r} point away from the camera"
        raise SceneError(f"{truth.path}: {what}; they are in world axes, towards the camera; {DEFINED}")


def _said(kind: str, shape: tuple[int, ...]) -> str:
    plain = {"i": "int", "u": "uint", "f": "float"}
    word = "texts" if kind[1] == "U" else f"{plain[kind[1]]}{8 * int(kind[2:])}"
    return f"{word} {list(shape)}"
