"""Pictures inside a page: shrunk to what a screen shows, as WebP, in the text of an address."""

import base64
from io import BytesIO

import numpy as np
from jaxtyping import Float, UInt8
from PIL import Image

from ringlight.measure.colormap import ember

MOST_SIDE = 800
"""Pixels of a picture's longer side; larger ones are shrunk by the mean over their pixels."""

QUALITY = 90
"""Of WebP, 0 to 100: no loss that one sees at the size that is shown."""

SCALE_WIDTH, SCALE_HEIGHT = 256, 12
"""Pixels of the colour scale."""

EFFORT = 4
"""Of WebP's encoder, 0 to 6."""


def picture_url(picture: UInt8[np.ndarray, "H W 3"]) -> str:
    """The picture as a data URL."""
    return _url(_shrunk(Image.fromarray(picture)))


def error_url(error: Float[np.ndarray, "H W"], top: float) -> str:
    """An error map whose scale ends at ``top``; what is larger looks the same. Shrunk before it is coloured."""
    small = np.asarray(_shrunk(Image.fromarray(error.astype(np.float32))))
    return _url(Image.fromarray(ember(small / top)))


def scale_url() -> str:
    """The colours of error maps from 0 to the end of their scale, left to right, as a data URL."""
    return _url(Image.fromarray(ember(np.tile(np.linspace(0, 1, SCALE_WIDTH), (SCALE_HEIGHT, 1)))))


def _shrunk(picture: Image.Image) -> Image.Image:
    share = MOST_SIDE / max(picture.size)
    if share >= 1:
        return picture
    return picture.resize(
        (max(round(picture.width * share), 1), max(round(picture.height * share), 1)), Image.Resampling.BOX
    )


def _url(picture: Image.Image) -> str:
    buffer = BytesIO()
    picture.save(buffer, "WEBP", quality=QUALITY, method=EFFORT)
    return "data:image/webp;base64," + base64.b64encode(buffer.getvalue()).decode()
