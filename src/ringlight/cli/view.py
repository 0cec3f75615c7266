"""``ringlight view RUN|SCENE ...``: look at models, or at a scene's cameras, in a browser."""

import sys
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, TextIO

import tyro

from ringlight.cli.arguments import Device, MaybeFolder
from ringlight.cli.gpu_build import tell_of_build
from ringlight.cli.parse import parse, refuse
from ringlight.cli.signals import kept_signals
from ringlight.cli.stages import stages
from ringlight.cli.threads import check_threads, use_threads
from ringlight.data.bundled import scene_folder

WAIT_SECONDS, MOVING_WAIT_SECONDS = 0.5, 0.03
"""Between two looks at what is asked, where nothing is; while a finer picture is due."""


@dataclass(frozen=True)
class ViewArguments:
    """Look at trained models in a browser, or at a scene's cameras, photographs and points (needs the [view] extra).

    Prints the address. Only this machine can open it, unless --host says otherwise; from another one use a tunnel: ssh
    -L 8080:127.0.0.1:8080 MACHINE. Ctrl-C ends it. To look while a run trains: ringlight train … --view.
    """

    paths: Annotated[
        tyro.conf.Positional[tuple[Path, ...]],
        tyro.conf.arg(metavar="RUN|SCENE [RUN ...]", help_behavior_hint="(required)"),
    ]
    """Run folders or model files of one scene, seen side by side or behind a curtain; or one folder of photographs with
    cameras."""
    scene: MaybeFolder = None
    """Folder of the photographs; by default the models' own."""
    host: str = "127.0.0.1"
    """Address to listen at. 0.0.0.0 is all of this machine's: whoever reaches it may look."""
    port: int = 8080
    """Port to listen at; 0 is any that is free."""
    device: Device = "auto"
    """Rasterizer: auto is the fastest that this machine has."""
    threads: int = 0
    """Threads of the kernels; 0 takes every core."""


def main(arguments: list[str]) -> int:
    """Serve until a signal comes; returns the exit code."""
    asked = parse(ViewArguments, "view", arguments)
    if not asked.paths:
        refuse("view", "nothing is named to look at; give a run folder, a model file, or a scene's folder")
    check_threads(asked.threads)
    with stages(quiet=False) as line:
        line(f"reading {asked.paths[0]}")
        from ringlight.view.open import open_subject
        from ringlight.view.viewer import Viewer, first_wishes
        from ringlight.view.viser_page import ViserPage
        from ringlight.view.viser_server import viser_library

        viser_library()  # before anything large is read
        use_threads(asked.threads)
        tell_of_build(asked.device)
        found = open_subject([scene_folder(path) for path in asked.paths], asked.scene, asked.device)
        wishes = first_wishes(found.subject)
        page = ViserPage(found.subject, wishes, asked.host, asked.port, is_trained=False)
        line.wiped()
    for sentence in found.missing:
        sys.stderr.write(f"warning: {sentence}\n")
    tell_address(page.address, asked.host, sys.stderr)
    viewer = Viewer(found.subject, page, wishes, files=found.files)
    try:
        with kept_signals() as stopping:
            while not stopping:
                wishes.changed.clear()
                if not viewer.turn():
                    wishes.changed.wait(MOVING_WAIT_SECONDS if viewer.is_moving else WAIT_SECONDS)
    finally:
        viewer.close()
    sys.stderr.write("\nthe viewer has ended\n")
    return 0


def tell_address(address: str, host: str, stream: TextIO) -> None:
    """Where to look; and a warning where others can."""
    from ringlight.view.same_host import is_loopback

    stream.write(f"look at {address}\n")
    if not is_loopback(host):
        sys.stderr.write(
            f"warning: whoever reaches {host} may look, and steer; leave out --host for this machine alone\n"
        )
