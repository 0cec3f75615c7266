"""The only list of formats: suffix -> writer."""

from ringlight.files.formats.contract import Writer
from ringlight.files.formats.gaussian_ply import GaussianPly

WRITERS: dict[str, Writer] = {
    ".ply": GaussianPly(),
}
