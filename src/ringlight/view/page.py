"""What the viewer needs of whatever shows its pictures: a server of a web page, or a test's record."""

from collections.abc import Mapping, Sequence
from typing import Protocol, runtime_checkable

import numpy as np
from jaxtyping import Float, UInt8

from ringlight.core.camera import Camera
from ringlight.files.camera_paths import Array
from ringlight.view.curves import Curves
from ringlight.view.standpoint import Standpoint


@runtime_checkable
class Page(Protocol):
    """Browsers are known by numbers; one that was closed meanwhile is passed over in silence."""

    def show(self, browser: int, picture: UInt8[np.ndarray, "H W 3"] | None, is_final: bool) -> None:
        """Fill the window with the picture, or with nothing; one that ``is_final`` will stay for a while."""
        ...

    def place(self, browser: int, standpoint: Standpoint, looked_at: Array) -> None:
        """Move a browser's camera; it turns round ``looked_at``, world units, from then on."""
        ...

    def tell(self, browser: int, sentence: str, is_trouble: bool = False) -> None:
        """Show one sentence."""
        ...

    def status(self, text: str, is_paused: bool) -> None:
        """The line on top, and whether the button says continue."""
        ...

    def curves(self, curves: Mapping[str, Curves]) -> None:
        """Draw them, by the names of the sources that they belong to."""
        ...

    def thumbnail(self, view: str, picture: UInt8[np.ndarray, "h w 3"]) -> None:
        """Hang a small photograph into its camera."""
        ...

    def hide_cameras(self, views: frozenset[str]) -> None:
        """Draw all cameras but these: who stands in one would see its photograph and nothing else."""
        ...

    def keys(self, cameras: Sequence[Camera], flight: Float[np.ndarray, "F 3"]) -> None:
        """Show the key frames, and the way of the camera between them."""
        ...

    def close(self) -> None:
        """End the server."""
        ...
