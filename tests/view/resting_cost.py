"""What a resting viewer costs a training: processor seconds in the viewer and in its server's threads.

    python tests/view/resting_cost.py SCENE METHOD [--steps 2000] [--window 1280 800]

They are counted inside the command, since two runs on a busy machine differ by more. This process is the browser: it
stands at the first test view, does not move, and is not counted.
"""

import argparse
import re
import subprocess
import sys
import tempfile
import threading
import time
from pathlib import Path

HERE = Path(__file__).parent
sys.path[:0] = [str(HERE), str(HERE.parent)]

INSIDE = "--inside"


def main() -> None:
    if sys.argv[1] == INSIDE:
        _train(sys.argv[2:])
        return
    asked = _asked()
    with tempfile.TemporaryDirectory() as folder:
        words = ["train", asked.scene, asked.method, "--steps", str(asked.steps), "--threads", "1", "--lpips"]
        words += ["--out", f"{folder}/run", "--view", "--port", "0"]
        command = [sys.executable, __file__, INSIDE, *words]
        with subprocess.Popen(command, stderr=subprocess.PIPE, stdout=subprocess.DEVNULL, text=True) as process:
            for line in process.stderr or ():
                if found := re.match(r"look at (\S+)", line):
                    threading.Thread(target=_rest, args=(found[1], asked), daemon=True).start()
                if line.startswith("counted: "):
                    sys.stdout.write(line.removeprefix("counted: "))


def _asked() -> argparse.Namespace:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("scene")
    parser.add_argument("method")
    parser.add_argument("--steps", type=int, default=2000)
    parser.add_argument("--window", type=int, nargs=2, default=(1280, 800))
    return parser.parse_args()


def _train(words: list[str]) -> None:
    """One command in this process, whose main thread trains and draws."""
    from ringlight.cli.main import run
    from ringlight.runs.session import Session
    from ringlight.view.live import LiveRun

    see, steps = LiveRun.see, Session.steps
    spent = {"viewer": 0.0, "threads": 0.0, "steps": 0.0}

    def seen(*given: object) -> object:
        begun = time.thread_time()
        found = see(*given)  # type: ignore[arg-type]
        spent["viewer"] += time.thread_time() - begun
        return found

    def stepped(session: Session) -> object:
        others = time.process_time() - time.thread_time()
        yield from steps(session)
        spent["threads"] = time.process_time() - time.thread_time() - others
        spent["steps"] = session.clock.cpu

    LiveRun.see, Session.steps = seen, stepped  # type: ignore[method-assign,assignment]
    run(words)
    parts = [f"{name} {seconds:.2f} s" for name, seconds in spent.items()]
    share = (spent["viewer"] + spent["threads"]) / spent["steps"]
    sys.stderr.write(f"counted: {', '.join(parts)}: {share:.1%} more\n")


def _rest(address: str, asked: argparse.Namespace) -> None:
    from browser import Browser

    from ringlight.data.bundled import scene_folder
    from ringlight.data.load import load_scene
    from ringlight.view.standpoint import standpoint_at

    browser, pictures = Browser(address), 0
    camera = load_scene(scene_folder(Path(asked.scene))).test[0].camera
    browser.stand(standpoint_at(camera, *asked.window))
    try:
        while True:
            browser.listen(1.0)
            pictures += sum(message["type"] == "BackgroundImageMessage" for message in browser.messages)
            browser.messages.clear()
    except Exception:  # the run has ended
        sys.stdout.write(f"{pictures} pictures came\n")


if __name__ == "__main__":
    main()
