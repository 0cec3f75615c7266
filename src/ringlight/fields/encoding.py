"""Fourier features: a coordinate and its sines and cosines in octaves (NeRF, eq. 4)."""

import math

import torch
from jaxtyping import Float
from torch import Tensor


def encoded_width(inputs: int, bands: int) -> int:
    """Columns that :func:`fourier_features` makes of ``inputs`` coordinates."""
    return inputs * (1 + 2 * bands)


def fourier_features(values: Float[Tensor, "*rows D"], bands: int) -> Float[Tensor, "*rows E"]:
    """The values themselves, then per coordinate sin(2^k pi u) for k < ``bands``, then the cosines likewise.

    ``values`` in [-1, 1]; the highest band has a period of 2^(2 - bands). E is :func:`encoded_width`.
    """
    frequencies = math.pi * 2.0 ** torch.arange(bands, dtype=values.dtype, device=values.device)
    phases = values[..., None] * frequencies
    waves = torch.cat([phases.sin(), phases.cos()], -1).flatten(-2)
    return torch.cat([values, waves], -1)
