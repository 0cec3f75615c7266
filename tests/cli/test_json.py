"""With --json standard output is one JSON document, whatever else is said, in every command that has the flag."""

import json
import shutil
from pathlib import Path

import pytest
from cli_session import flags
from command import Command

from ringlight.cli.main import VERBS
from ringlight.data.load import load_scene
from true_normals_file import write_truth

SHORT = flags(steps=3, initial_points=100)

RESULTS = Path(__file__).parents[2] / "benchmarks" / "results"

LINES = {
    "train": ("train", "{scene}", "3dgs", *SHORT, "--lpips", "--out", "{new}"),
    "train --resume": ("train", "--resume", "{run}"),
    "train --verify": ("train", "{scene}", "3dgs", *SHORT, "--verify", "2"),
    "eval": ("eval", "{run}", "--lpips"),
    "compare": ("compare", "{run}", "{other}"),
    "compare --sheet": ("compare", "{run}", "{other}", "--sheet", "{new}.png"),
    "normals": ("normals", "{run}", "{other}", "--truth", "{truth}"),
    "report": ("report", "{run}", "{other}", "{new}.html"),
    "render": ("render", "{run}", "--path", "orbit", "--frames", "2", "--out", "{new}"),
    "share": ("share", "{run}", "{new}.html"),
    "study": ("study", "rank", "{scene}", *flags(steps=2, seeds=1), "--lpips", "--only", "rank-4", "--out", "{new}"),
    "study --dry-run": ("study", "rank", "{scene}", "--dry-run", "--out", "{new}"),
    "table": ("table", "{scene}", "--methods", "3dgs", *flags(steps=2), "--lpips", "--out", "{new}"),
    "table --dry-run": ("table", "{scene}", "--methods", "3dgs", "--dry-run", "--out", "{new}"),
    "reproduce": ("reproduce", "--results", str(RESULTS)),
    "info": ("info", "{run}"),
    "compress": ("compress", "{run}", "{new}.safetensors"),
    "edit": ("edit", "{run}", "{new}.safetensors", "--residual", "0.5"),
    "relight": ("relight", "{run}", "{scene}", "{new}", "--steps", "3", "--lpips"),
    "export": ("export", "{run}", "{new}.ply", "--fit-steps", "2"),
    "import": ("import", "{ply}", "{new}.safetensors"),
    "doctor": ("doctor",),
    "bench raster": ("bench", "raster", "--rounds", "1", "--sizes", "1k@32"),
}


@pytest.mark.parametrize("name", LINES)
def test_standard_output_is_one_document(
    name: str, tiny: Path, trained: dict[str, Path], tmp_path: Path, ringlight: Command
) -> None:
    run = Path(shutil.copytree(trained["ringlight-ring"], tmp_path / "run"))
    ply = trained["3dgs"].parent / "3dgs.ply"
    if not ply.exists():
        assert ringlight("export", trained["3dgs"], ply).code == 0
    truth = write_truth(tmp_path / "truth.npz", load_scene(tiny))
    places = {"ply": ply, "truth": truth, "scene": tiny, "run": run, "other": trained["3dgs"], "new": tmp_path / "new"}
    done = ringlight(*(word.format(**places) for word in LINES[name]), "--json")
    assert done.code in (0, 1) if name == "doctor" else done.code == 0, done.err
    assert isinstance(json.loads(done.out), dict)


def test_no_command_with_the_flag_is_left_out(capsys: pytest.CaptureFixture[str]) -> None:
    from ringlight.cli.main import run

    asked = {name.split()[0] for name in LINES} | {"poses"}  # which test_poses_command.py asks, where COLMAP is there
    for verb in VERBS:
        run([verb, *(["raster"] if verb == "bench" else []), "--help"])
        assert ("--json" in capsys.readouterr().out) == (verb in asked), verb


def test_a_dry_run_lists_what_the_lines_say(tiny: Path, tmp_path: Path, ringlight: Command) -> None:
    words = ("study", "rank", tiny, "--steps", "7", "--seeds", "1", "--out", tmp_path / "out", "--dry-run")
    listed = json.loads(ringlight(*words, "--json").out)["runs"]
    lines = ringlight(*words).out.splitlines()
    assert [run["folder"] for run in listed] == [line.split()[0] for line in lines[:-1]]
    assert {run["state"] for run in listed} == {"to do"}
    assert {run["steps"] for run in listed} == {7}
    assert not (tmp_path / "out").exists()
