"""The bundled scene with 1, 2 and 4 threads: are the model files the same? What ``make threads`` runs.

python tests/thread_hashes.py --steps 300
"""

import argparse
import hashlib
import sys
import tempfile
from dataclasses import replace
from pathlib import Path

from long_record import write_record
from ringlight.cli.threads import use_threads
from ringlight.data.bundled import bundled_scene
from ringlight.data.options import SceneOptions
from ringlight.methods.table import METHODS
from ringlight.models.contract import Count
from ringlight.runs.start import start_run

SCENE, THREADS = "toaster", (1, 2, 4)


def model_hash(method: str, steps: int, threads: int) -> tuple[str, Count]:
    """Of the model file that a run leaves, and what it is made of."""
    use_threads(threads)
    recipe = replace(METHODS[method], steps=steps)
    with tempfile.TemporaryDirectory(prefix="ringlight-") as folder:
        session = start_run(
            Path(folder) / "run", bundled_scene(SCENE), method, recipe, SceneOptions(), seed=0, device="cpu"
        )
        for _ in session.steps():
            pass
        session.save()
        session.lock.release()
        return hashlib.sha256(session.folder.model.read_bytes()).hexdigest(), session.training.model.counted()


def main() -> int:
    """Exit code 1 where any differ."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--steps", type=int, default=300)
    parser.add_argument(
        "--methods",
        nargs="+",
        default=["3dgs", "ringlight-basis", "ringlight-ring", "ringlight-mirror", "tensorf", "putt"],
        choices=METHODS,
    )
    parser.add_argument("--record", type=Path, help="JSON file to write")
    asked = parser.parse_args()
    rows = []
    for method in asked.methods:
        found = [model_hash(method, asked.steps, threads) for threads in THREADS]
        same = len(set(found)) == 1
        digests, counts = zip(*found, strict=True)
        rows.append(
            {"method": method, "same": same, "count": counts[0].number, "of": counts[0].noun, "sha256": digests}
        )
        verdict = "the same bits" if same else "OTHER BITS"
        print(f"{method:17} {counts[0]!s:>19}  {digests[0][:16]}  {verdict} with 1, 2, 4 threads", flush=True)  # noqa: T201
    if asked.record:
        command = " ".join(["python", *sys.argv])
        write_record(asked.record, command=command, scene=SCENE, steps=asked.steps, threads=THREADS, rows=rows)
    return int(not all(row["same"] for row in rows))


if __name__ == "__main__":
    sys.exit(main())
