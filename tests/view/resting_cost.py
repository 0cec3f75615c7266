"""What a resting viewer costs a training: processor seconds of the whole command, with and without one.

    python tests/view/resting_cost.py SCENE METHOD [--steps 2000] [--rounds 2] [--window 1280 800]

Runs take turns. A browser's websocket stands at the first test view and does not move; its own process, which only
listens, is not counted.
"""

import argparse
import os
import re
import subprocess
import sys
import tempfile
import threading
from pathlib import Path
from statistics import fmean

HERE = Path(__file__).parent
sys.path[:0] = [str(HERE), str(HERE.parent)]

from browser import Browser  # noqa: E402

from ringlight.data.bundled import scene_folder  # noqa: E402
from ringlight.data.load import load_scene  # noqa: E402
from ringlight.view.standpoint import Standpoint, standpoint_at  # noqa: E402


def main() -> None:
    asked = _asked()
    camera = (load_scene(scene_folder(asked.scene)).test)[0].camera
    point = standpoint_at(camera, *asked.window)
    spent: dict[str, list[float]] = {"without": [], "nobody looks": [], "resting": []}
    for _ in range(asked.rounds):
        for kind, seconds in spent.items():
            seconds.append(_seconds(asked, kind, point))
            sys.stdout.write(f"{kind:13} {seconds[-1]:7.2f} s\n")
            sys.stdout.flush()
    alone = fmean(spent["without"])
    for kind, seconds in spent.items():
        sys.stdout.write(f"{kind:13} {fmean(seconds):7.2f} s  {fmean(seconds) / alone - 1:+.1%}\n")


def _asked() -> argparse.Namespace:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("scene", type=Path)
    parser.add_argument("method")
    parser.add_argument("--steps", type=int, default=2000)
    parser.add_argument("--rounds", type=int, default=2)
    parser.add_argument("--window", type=int, nargs=2, default=(1280, 800))
    return parser.parse_args()


def _seconds(asked: argparse.Namespace, kind: str, point: Standpoint) -> float:
    """Processor seconds, user and system, of one command."""
    with tempfile.TemporaryDirectory() as folder:
        words = ["train", str(asked.scene), asked.method, "--steps", str(asked.steps), "--threads", "1", "--lpips"]
        words += ["--out", f"{folder}/run", *(["--view", "--port", "0"] if kind != "without" else [])]
        process = subprocess.Popen([sys.executable, "-m", "ringlight", *words], stderr=subprocess.PIPE, text=True)
        assert process.stderr is not None
        for line in process.stderr:
            found = re.match(r"look at (\S+)", line)
            if found and kind == "resting":
                threading.Thread(target=_rest, args=(found[1], point), daemon=True).start()
        _, status, usage = os.wait4(process.pid, 0)
        process.returncode = os.waitstatus_to_exitcode(status)
        assert process.returncode == 0
        return usage.ru_utime + usage.ru_stime


def _rest(address: str, point: Standpoint) -> None:
    browser = Browser(address)
    browser.stand(point)
    pictures = 0
    try:
        while True:
            browser.listen(1.0)
            pictures += sum(message["type"] == "BackgroundImageMessage" for message in browser.messages)
            browser.messages.clear()
    except Exception:  # the run has ended
        sys.stdout.write(f"{pictures} pictures came\n")


if __name__ == "__main__":
    main()
