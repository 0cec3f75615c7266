"""Calls of the compiled module, kept in a file and made again without torch: ``make valgrind`` runs this.

    recorded_calls.py record FILE           train each method for a few steps, draw, keep what the kernels were asked
    recorded_calls.py replay FILE MODULE    ask the module of that path the same, with numpy's arrays

torch under valgrind takes an hour before the first kernel, numpy a minute. Every array is memory of its own, as long as
it must be, so that a read or a write beside it is seen.
"""

import importlib.machinery
import importlib.util
import json
import sys
from pathlib import Path
from typing import Any

import numpy as np

STEPS = 3


class Log:
    """Calls in their order, as JSON values; the arrays that they name lie in ``arrays``."""

    def __init__(self) -> None:
        self.calls: list[dict[str, Any]] = []
        self.arrays: dict[str, np.ndarray] = {}
        self.objects = 0

    def add(self, name: str, on: int | None, arguments: tuple[Any, ...], named: dict[str, Any]) -> None:
        by_name = {key: self.plain(value) for key, value in named.items()}
        self.calls.append({"name": name, "on": on, "arguments": self.plain(arguments), "named": by_name})

    def plain(self, value: Any) -> Any:
        """As JSON takes it, with the array's content as it is before the call."""
        if isinstance(value, Stand):
            return {"object": value.number}
        if isinstance(value, list | tuple):
            return [self.plain(item) for item in value]
        if hasattr(value, "detach"):
            name = f"a{len(self.arrays)}"
            self.arrays[name] = value.detach().numpy().copy()
            return {"array": name}
        return value

    def save(self, path: Path) -> None:
        text = np.frombuffer(json.dumps(self.calls).encode(), dtype=np.uint8)
        np.savez(path, calls=text, **self.arrays)


class Stand:
    """An object of the module, whose calls are kept."""

    def __init__(self, log: Log, name: str, make: Any, arguments: tuple[Any, ...], named: dict[str, Any]) -> None:
        self.log, self.number = log, log.objects
        log.objects += 1
        log.add(name, None, arguments, named)
        self.real = make(*_real(arguments), **_real(named))

    def __getattr__(self, name: str) -> Any:
        found = getattr(self.real, name)
        if not callable(found):
            return found

        def call(*arguments: Any, **named: Any) -> Any:
            self.log.add(name, self.number, arguments, named)
            return found(*_real(arguments), **_real(named))

        return call


def _real(value: Any) -> Any:
    if isinstance(value, Stand):
        return value.real
    if isinstance(value, dict):
        return {key: _real(item) for key, item in value.items()}
    return type(value)(_real(item) for item in value) if isinstance(value, list | tuple) else value


def record(path: Path) -> int:
    """Every function and class of the module must be among the calls."""
    from ringlight import _kernels

    log = Log()
    functions = [name for name in vars(_kernels) if name[0].islower() and name not in SETTINGS]

    def kept(name: str, call: Any) -> Any:
        def keep(*arguments: Any, **named: Any) -> Any:
            log.add(name, None, arguments, named)
            return call(*_real(arguments), **_real(named))

        return keep

    for name in functions:
        setattr(_kernels, name, kept(name, getattr(_kernels, name)))
    classes = _classes(_kernels)
    for name in classes:
        make = getattr(_kernels, name)
        setattr(_kernels, name, lambda *a, name=name, make=make, **named: Stand(log, name, make, a, named))
    _train_all()
    log.save(path)
    left_out = {*functions, *classes} - {call["name"] for call in log.calls}
    print(f"{len(log.calls)} calls kept; never called: {', '.join(sorted(left_out)) or 'none'}")  # noqa: T201
    return int(bool(left_out))


def _classes(module: Any) -> list[str]:
    """Of which objects are made: all but those that others are kinds of."""
    found = {name: value for name, value in vars(module).items() if isinstance(value, type)}
    return [name for name, value in found.items() if not value.__subclasses__()]


SETTINGS = ("isa", "threads", "set_threads", "keep_freed_memory", "set_memory", "largest_buffer", "multiply_adds")
"""What asks no kernel."""


def _train_all() -> None:
    import dataclasses

    import torch

    from ringlight.core.gradients import dense
    from ringlight.core.want import Want
    from ringlight.fit.train import train
    from ringlight.methods.table import METHODS
    from ringlight.methods.tensorf import TensorfRecipe
    from ringlight.rasterize.choose import rasterizer_for
    from ringlight.volume.tensor_train_field import TensorTrainField

    sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "tests"))
    from small_recipes import COARSE, with_settings
    from tiny_scene import tiny_scene

    for preset in (*METHODS.values(), TensorfRecipe(decomposition="cp")):
        scene, rasterize = tiny_scene(views=3, size=24), rasterizer_for("cpu")
        recipe, _ = with_settings(preset, COARSE).settled(scene, rasterize, 0)  # whole volumes are gigabytes of calls
        recipe = dataclasses.replace(recipe, steps=STEPS)
        training = recipe.build(scene, rasterize, 0)
        for _ in train(training):
            pass
        camera, background = scene.train[0].camera, scene.background_color
        for want in Want:
            training.model.render(camera, background, want)
        training.model.render(camera, background, Want.PICTURE, ("alpha",))  # whose shader cannot work tile by tile
        drawn = training.model.render(camera, background, Want.GRADIENTS)
        for gradient in drawn.backward(torch.ones_like(drawn.color), {}).values():
            dense(gradient)
    # Fine tensor trains have a way of their own, and so few steps leave them empty.
    field = TensorTrainField(7, 7, (4, 6), 5, torch.Generator().manual_seed(0))
    field.appearance(torch.rand(300, 3)).sum().backward()


def replay(path: Path, module: Path) -> int:
    """The same calls; what they return was looked at by the tests."""
    spec = importlib.util.spec_from_file_location("_kernels", module)
    assert spec is not None
    assert spec.loader is not None
    kernels = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(kernels)
    kernels.set_threads(2)
    stored = np.load(path)
    objects: list[Any] = []

    def value(plain: Any) -> Any:
        if isinstance(plain, dict):
            return objects[plain["object"]] if "object" in plain else stored[plain["array"]].copy()
        return [value(item) for item in plain] if isinstance(plain, list) else plain

    calls = json.loads(stored["calls"].tobytes())
    for call in calls:
        on = kernels if call["on"] is None else objects[call["on"]]
        named = {key: value(plain) for key, plain in call["named"].items()}
        found = getattr(on, call["name"])(*value(call["arguments"]), **named)
        if call["on"] is None and isinstance(getattr(kernels, call["name"]), type):
            objects.append(found)
    print(f"{len(calls)} calls made again, instruction set {kernels.isa()}")  # noqa: T201
    return 0


if __name__ == "__main__":
    verb, file, *rest = sys.argv[1:]
    sys.exit(record(Path(file)) if verb == "record" else replay(Path(file), Path(rest[0])))
