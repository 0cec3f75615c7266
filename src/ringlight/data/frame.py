"""One photograph of a scene, before it is known at which size it is used."""

from dataclasses import dataclass
from pathlib import Path

from ringlight.core.camera import Camera
from ringlight.data.folder import image_inside
from ringlight.data.image_files import ImageHeader
from ringlight.data.mask_files import MaskFile
from ringlight.data.undistort import Undistortion


@dataclass(frozen=True)
class NamedMask:
    """A mask as a scene names it, below the folder ``base``; nobody has looked for it yet. ``where`` says who names
    it."""

    base: Path
    name: str
    where: str

    def path(self) -> Path:
        """Where it lies, or should. Raises SceneError for a name that leaves the folder, that no file can have, or of a
        link that leads nowhere."""
        return image_inside(self.base, self.name, self.where) or self.base / self.name


@dataclass(frozen=True)
class Frame:
    """One image file and its camera. ``name`` is the path below the images' folder, with slashes; the camera has the
    size of the file, or of the picture that ``undistortion`` makes of it; ``mask`` becomes its alpha, where there is
    one; ``named_mask`` is what the scene says of it, and becomes ``mask`` where masks of the scene are wanted."""

    name: str
    path: Path
    camera: Camera
    header: ImageHeader
    mask: MaskFile | None = None
    undistortion: Undistortion | None = None
    named_mask: NamedMask | None = None

    @property
    def has_alpha(self) -> bool:
        """Whether its pixels get a fourth channel."""
        return self.header.has_alpha or self.mask is not None
