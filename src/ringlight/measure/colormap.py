"""A colour map for error pictures: black, purple, red, orange, cream, with evenly rising lightness.

The table was drawn in CIELAB: lightness L* goes from 3 to 97 in equal steps, the hue once from blue to yellow, with as
much chroma as sRGB holds. Equal steps of error therefore look equal, also in grey print and to colour-blind eyes.
"""

import numpy as np
from jaxtyping import Float, UInt8

EMBER_HEX = (
    "070b15 101735 261d50 452061 681d6d 8c1272 ad086e cb0c66 e5215a "
    "f3444e fd6242 ff823f fe9e41 f8ba58 f5d178 f6e6a3 fbf8d5"
)
EMBER = np.array([list(bytes.fromhex(code)) for code in EMBER_HEX.split()], dtype=np.float64)
"""sRGB in 0..255, 17 colours at equal distances."""


def ember(values: Float[np.ndarray, "H W"]) -> UInt8[np.ndarray, "H W 3"]:
    """Colours for values in [0, 1]; values beyond are clamped, NaN counts as 1."""
    position = np.clip(np.nan_to_num(values, nan=1.0), 0, 1) * (len(EMBER) - 1)
    below = np.minimum(position.astype(np.intp), len(EMBER) - 2)
    weight = (position - below)[..., None]
    return np.rint(EMBER[below] * (1 - weight) + EMBER[below + 1] * weight).astype(np.uint8)
