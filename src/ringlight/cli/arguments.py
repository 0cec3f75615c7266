"""Words that several commands take, and how the help shows them."""

from pathlib import Path
from typing import Annotated, Literal

import tyro

_no_default = ""
"""Shown instead of "(default: None)", which tells nobody anything."""

ModelPath = Annotated[tyro.conf.Positional[Path], tyro.conf.arg(metavar="MODEL")]
SceneFolder = Annotated[
    tyro.conf.Positional[Path | None], tyro.conf.arg(metavar="[SCENE]", help_behavior_hint=_no_default)
]
MaybeFolder = Annotated[Path | None, tyro.conf.arg(metavar="FOLDER", help_behavior_hint=_no_default)]
MaybeWhole = Annotated[int | None, tyro.conf.arg(metavar="INT", help_behavior_hint=_no_default)]
MaybeReal = Annotated[float | None, tyro.conf.arg(metavar="FLOAT", help_behavior_hint=_no_default)]

Device = Literal["auto", "cpu", "cuda", "reference"]
Net = Literal["alex", "vgg"]
