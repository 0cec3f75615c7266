"""LPIPS, the learned perceptual distance of Zhang et al. 2018 (version 0.1), with AlexNet or VGG16 features.

The weights are not part of the package: ``ringlight fetch-lpips`` puts them into the user's cache.
"""

import os
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

import torch
import torch.nn.functional as F
from jaxtyping import Float
from safetensors import SafetensorError, safe_open
from safetensors.torch import load_file
from torch import Tensor

from ringlight.errors import ModelFileError, SceneError

Net = Literal["alex", "vgg"]

SHIFT = (-0.030, -0.088, -0.188)
SCALE = (0.458, 0.448, 0.450)
"""Mean and deviation of ImageNet's channels, for images in [-1, 1]."""

EPSILON = 1e-10
"""Keeps the length of a feature vector away from 0, as the authors' code has it."""


@dataclass(frozen=True)
class Convolution:
    """One layer of features: convolution, then ReLU. ``tap``: its result is compared."""

    inputs: int
    outputs: int
    size: int
    stride: int = 1
    padding: int = 1
    pool: int = 0
    """Width of a max pooling with stride 2 before this layer; 0 for none."""
    tap: bool = True


LAYERS: dict[str, tuple[Convolution, ...]] = {
    "alex": (
        Convolution(3, 64, 11, stride=4, padding=2),
        Convolution(64, 192, 5, padding=2, pool=3),
        Convolution(192, 384, 3, pool=3),
        Convolution(384, 256, 3),
        Convolution(256, 256, 3),
    ),
    "vgg": (
        Convolution(3, 64, 3, tap=False),
        Convolution(64, 64, 3),
        Convolution(64, 128, 3, pool=2, tap=False),
        Convolution(128, 128, 3),
        Convolution(128, 256, 3, pool=2, tap=False),
        Convolution(256, 256, 3, tap=False),
        Convolution(256, 256, 3),
        Convolution(256, 512, 3, pool=2, tap=False),
        Convolution(512, 512, 3, tap=False),
        Convolution(512, 512, 3),
        Convolution(512, 512, 3, pool=2, tap=False),
        Convolution(512, 512, 3, tap=False),
        Convolution(512, 512, 3),
    ),
}

SMALLEST = {"alex": 31, "vgg": 16}
"""Pixels a side below which a pooling has nothing to pool."""


def weights_folder() -> Path:
    """Where weights are kept: $RINGLIGHT_CACHE, else $XDG_CACHE_HOME/ringlight, else ~/.cache/ringlight."""
    if chosen := os.environ.get("RINGLIGHT_CACHE"):
        return Path(chosen)
    return Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache") / "ringlight"


def weights_path(net: Net) -> Path:
    """The safetensors file with the weights of ``net``."""
    return weights_folder() / f"lpips-{net}.safetensors"


def weights_status(net: Net) -> str:
    """Empty if the weights are there and whole, otherwise a sentence that says how to get them."""
    if not weights_path(net).is_file():
        return weights_missing(net)
    return weights_damaged(net) if weights_fault(net) else ""


def weights_missing(net: Net) -> str:
    """The sentence that says so, whether they are missing or not; reports keep it."""
    return (
        f"LPIPS with {net} is unavailable: its weights are not on this machine; get them with 'ringlight fetch-lpips'."
    )


def weights_damaged(net: Net) -> str:
    """The sentence that says so, whether they are or not; reports keep it."""
    return f"LPIPS with {net} is unavailable: its weights are damaged; get them again with 'ringlight fetch-lpips'."


def weights_fault(net: Net) -> str:
    """What is wrong with the weights file, which is there, or nothing; only its header is read."""
    try:
        with safe_open(weights_path(net), framework="pt") as file:
            shapes = {name: tuple(file.get_slice(name).get_shape()) for name in file.keys()}  # noqa: SIM118
    except (OSError, SafetensorError) as error:
        return f"cannot be read ({error})"
    return "" if shapes == tensor_shapes(net) else f"holds other tensors than LPIPS with {net}"


class Lpips:
    """The distance of two images; 0 for equal ones, about 0.7 for unrelated ones.

    Raises:
        ModelFileError: the weights are missing or damaged.
    """

    def __init__(self, net: Net = "alex"):
        self.net = net
        self.layers = LAYERS[net]
        self._weights = _load(net)

    def __call__(self, image: Float[Tensor, "H W 3"], truth: Float[Tensor, "H W 3"], *, rescale: bool = True) -> float:
        """Distance of two images in [0, 1].

        ``rescale=False`` leaves out the scaling to [-1, 1] that the network was trained with: the mistake of 3DGS's
        evaluation, for comparison with papers that share it (numbers some 30 to 40 per cent lower).

        Raises:
            SceneError: the images are too small for the network.
        """
        smallest = SMALLEST[self.net]
        if min(image.shape[:2]) < smallest:
            size = f"{image.shape[1]} x {image.shape[0]}"
            raise SceneError(f"LPIPS needs images of {smallest} x {smallest} pixels or more, not {size}; leave it out")
        pair = torch.stack((image, truth)).detach().cpu().float().clamp(0, 1).permute(0, 3, 1, 2)
        with torch.inference_mode():
            return self._distance(pair * 2 - 1 if rescale else pair)

    def _distance(self, pair: Float[Tensor, "2 3 H W"]) -> float:
        features = (pair - torch.tensor(SHIFT)[:, None, None]) / torch.tensor(SCALE)[:, None, None]
        distance, head = 0.0, 0
        for index, layer in enumerate(self.layers):
            if layer.pool:
                features = F.max_pool2d(features, layer.pool, stride=2)
            weight, bias = self._weights[f"features.{index}.weight"], self._weights[f"features.{index}.bias"]
            features = F.conv2d(features, weight, bias, stride=layer.stride, padding=layer.padding).relu_()
            if layer.tap:
                unit = features / (features.square().sum(1, keepdim=True).sqrt() + EPSILON)
                importance = self._weights[f"heads.{head}"]
                distance += (unit[0] - unit[1]).square().mean((1, 2)).dot(importance).item()
                head += 1
        return distance


def tensor_shapes(net: Net) -> dict[str, tuple[int, ...]]:
    """Every tensor of a weights file, by name."""
    shapes: dict[str, tuple[int, ...]] = {}
    taps = [layer for layer in LAYERS[net] if layer.tap]
    for index, layer in enumerate(LAYERS[net]):
        shapes[f"features.{index}.weight"] = (layer.outputs, layer.inputs, layer.size, layer.size)
        shapes[f"features.{index}.bias"] = (layer.outputs,)
    for head, layer in enumerate(taps):
        shapes[f"heads.{head}"] = (layer.outputs,)
    return shapes


def _load(net: Net) -> dict[str, Tensor]:
    path = weights_path(net)
    if not path.is_file():
        raise ModelFileError(weights_missing(net))
    fault = weights_fault(net)
    if fault:
        raise ModelFileError(f"{path}: {fault}; run 'ringlight fetch-lpips' again")
    try:
        weights = load_file(path)
    except (OSError, SafetensorError) as error:
        raise ModelFileError(f"{path}: cannot be read ({error}); run 'ringlight fetch-lpips' again") from error
    return {name: tensor.float() for name, tensor in weights.items()}
