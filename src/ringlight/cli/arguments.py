"""Words that several commands take, and how the help shows them."""

from pathlib import Path
from typing import Annotated, Literal

import tyro

ModelPath = Annotated[tyro.conf.Positional[Path], tyro.conf.arg(metavar="MODEL")]
SceneFolder = Annotated[tyro.conf.Positional[Path | None], tyro.conf.arg(metavar="[SCENE]")]
MaybeFolder = Annotated[Path | None, tyro.conf.arg(metavar="FOLDER")]

Device = Literal["auto", "cpu", "cuda", "reference"]
Net = Literal["alex", "vgg"]
