"""Scenes photographed through every lens that is undistorted, trained and measured beside those of a pinhole.

    python tests/lens_matrix.py SCENE… --seeds 3                 what ``make lenses`` runs

Prints the mean difference in test PSNR over the seeds, and its standard error. What was measured is written down after
every run, and the same command goes on from there.
"""

import argparse
import json
import statistics
import subprocess
import sys
import tempfile
from pathlib import Path
from typing import Any

from distorted_copies import COEFFICIENTS, copy_scene
from long_record import write_record

COPIES = ("straight", "bent")


def said(*words: object) -> str:
    """What ``ringlight`` prints to these words."""
    command = [sys.executable, "-m", "ringlight", *map(str, words), "--threads", "1"]
    return subprocess.run(command, check=True, stdout=subprocess.PIPE, encoding="utf-8").stdout


def measured(copies: Path, copy: str, steps: int, seed: int) -> float:
    """Test PSNR in dB, on the photographs of the pinhole."""
    run = copies / f"run-{copy}-{seed}"
    said("train", copies / copy, "3dgs", "--steps", steps, "--seed", seed, "--out", run, "--quiet")
    return float(json.loads(said("eval", run, copies / "straight", "--json"))["psnr"])


def table(found: dict[str, dict[str, float]], scene: str) -> list[str]:
    """A line a lens: the means of both copies, and the difference with its standard error."""
    lines = []
    for model in COEFFICIENTS:
        cells = [cell for name, cell in found.items() if name.startswith(f"{scene} {model} ") and len(cell) == 2]
        if cells:
            means = [statistics.fmean(cell[copy] for cell in cells) for copy in COPIES]
            differences = [cell["bent"] - cell["straight"] for cell in cells]
            error = statistics.stdev(differences) / len(cells) ** 0.5 if len(cells) > 1 else float("nan")
            row = f"{means[0]:.2f} | {means[1]:.2f} | {means[1] - means[0]:+.2f} ± {error:.2f}"
            lines.append(f"| {scene} | {model} | {row} |")
    return lines


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("scenes", type=Path, nargs="+")
    parser.add_argument("--seeds", type=int, default=3)
    parser.add_argument("--steps", type=int, default=1000)
    parser.add_argument(
        "--record", type=Path, default=Path("lens-matrix.json"), help="JSON file to write and go on from"
    )
    asked = parser.parse_args()
    known = json.loads(asked.record.read_text()) if asked.record.exists() else {"steps": asked.steps, "psnr": {}}
    if known["steps"] != asked.steps:
        parser.error(f"{asked.record} is of {known['steps']} steps; name another --record")
    found: dict[str, dict[str, Any]] = known["psnr"]
    for scene in asked.scenes:
        for model in COEFFICIENTS:
            cells = {seed: found.setdefault(f"{scene.name} {model} {seed}", {}) for seed in range(asked.seeds)}
            if all(len(cell) == len(COPIES) for cell in cells.values()):
                continue
            with tempfile.TemporaryDirectory(prefix="ringlight-lenses-") as folder:
                copies = Path(folder)
                copy_scene(scene, model, copies)
                for seed, cell in cells.items():
                    for copy in COPIES:
                        if copy not in cell:
                            cell[copy] = measured(copies, copy, asked.steps, seed)
                            write_record(asked.record, steps=asked.steps, psnr=found)
        print(*table(found, scene.name), sep="\n")  # noqa: T201


if __name__ == "__main__":
    main()
