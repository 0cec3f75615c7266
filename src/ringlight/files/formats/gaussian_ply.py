"""The PLY of 3D Gaussian Splatting."""

from pathlib import Path

from ringlight.files.formats.contract import Content, Form


class GaussianPly:
    """See :mod:`ringlight.files.ply` for its columns."""

    form = Form.HARMONICS
    about = "viewers of 3D Gaussians"

    def write(self, path: Path, content: Content) -> None:
        from ringlight.core.gaussians import Gaussians
        from ringlight.files.ply import write_gaussian_ply

        gaussians = Gaussians.from_columns(content.tensors)
        sh_dc, sh_rest = gaussians.appearance["sh_dc"], gaussians.appearance["sh_rest"]
        write_gaussian_ply(path, gaussians, sh_dc, sh_rest, content.antialiased, content.comments)
