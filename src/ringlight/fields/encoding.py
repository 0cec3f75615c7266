"""Fourier features: a coordinate, unless it is left out, and its sines and cosines in octaves (NeRF, eq. 4)."""

import math
from dataclasses import dataclass

import torch
from jaxtyping import Float
from torch import Tensor


@dataclass(frozen=True)
class FourierCode:
    """``bands`` octaves of frequencies, 2^k pi or 2^k, behind the ``identity``."""

    bands: int
    pi: bool = True
    identity: bool = True

    def width(self, inputs: int) -> int:
        """Columns that :func:`fourier_features` makes of ``inputs`` coordinates."""
        return inputs * (self.identity + 2 * self.bands)


def fourier_features(values: Float[Tensor, "*rows D"], code: FourierCode) -> Float[Tensor, "*rows E"]:
    """The values themselves if wanted, then per coordinate sin(2^k pi u) for k < bands, then the cosines likewise.

    ``values`` in [-1, 1]; the highest band has a period of 2^(2 - bands), or pi times that without pi. E is the code's
    width.
    """
    scale = math.pi if code.pi else 1.0
    frequencies = scale * 2.0 ** torch.arange(code.bands, dtype=values.dtype, device=values.device)
    phases = values[..., None] * frequencies
    waves = torch.cat([phases.sin(), phases.cos()], -1).flatten(-2)
    return torch.cat([values, waves], -1) if code.identity else waves
