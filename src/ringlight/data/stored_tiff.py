"""TIFF with its pixels as they lie in the file. Pillow turns or mirrors those of a TIFF by its EXIF orientation when it
decodes, as it does for no other format; and where it maps uncompressed grey into memory it confuses the sides."""

from PIL import ExifTags
from PIL.TiffImagePlugin import IMAGELENGTH, IMAGEWIDTH, TiffImageFile

UPRIGHT = 1
"""The orientation of pixels that are to be shown as they lie."""


class StoredTiff(TiffImageFile):
    """``size`` and pixels are those that are stored. The orientation is told by ``getexif`` until they are decoded."""

    def _setup(self) -> None:
        super()._setup()
        self._size = self.tag_v2[IMAGEWIDTH], self.tag_v2[IMAGELENGTH]
        self._tile_orientation = UPRIGHT  # which Pillow 10.0 goes by

    def load_end(self) -> None:
        # In EXIF rather than in the tags: Pillow reads the orientation there, where XMP can bring it too.
        self.getexif()[ExifTags.Base.Orientation] = UPRIGHT
        super().load_end()
