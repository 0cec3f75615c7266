"""``ringlight poses`` as a person uses it: from a folder of photographs to a trained scene, and what may go wrong."""

import json
import os
import signal
import subprocess
import sys
import time
from contextlib import suppress
from pathlib import Path

import pytest
import torch
from command import Command
from textured_room import photograph, save_photographs, shots

from ringlight.files.video import write_video
from ringlight.poses import process


def holders(folder: Path) -> list[int]:
    """Processes that hold a file below the folder open."""
    found = []
    for process_folder in Path("/proc").glob("[0-9]*"):
        with suppress(OSError):
            names = [str(handle.readlink()) for handle in (process_folder / "fd").iterdir()]
            found += [int(process_folder.name)] * any(name.startswith(str(folder)) for name in names)
    return found


def test_wrong_usage_and_wrong_input(tmp_path: Path, ringlight: Command):
    assert ringlight("poses").code == 2
    for threads in ("-1", "99999999999"):
        assert "give a number of threads" in ringlight("poses", tmp_path, "--threads", threads).err
    assert "warning: --threads is 1024" in ringlight("poses", tmp_path, "--threads", 1024).err
    refused = ringlight("poses", tmp_path, "--features", "7")
    assert (refused.code, refused.out) == (1, "")
    assert "--features is 7: give a whole number of at least 100" in refused.err
    empty = ringlight("poses", tmp_path)
    assert empty.code == 1
    assert "holds no photographs" in empty.err
    assert "no such folder or film" in ringlight("poses", tmp_path / "none").err


def test_without_the_extra_one_sentence_names_it(tmp_path: Path, ringlight: Command, monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setattr(process, "find_spec", lambda name: None)
    save_photographs(tmp_path / "photos", 3)
    outcome = ringlight("poses", tmp_path / "photos")
    assert outcome.code == 1
    assert outcome.err.endswith("pip install 'ringlight[sfm]'\n")
    assert not (tmp_path / "photos-scene").exists()


def test_a_black_film_is_one_sentence(tmp_path: Path, ringlight: Command):
    write_video(tmp_path / "night.mp4", [torch.zeros(64, 96, 3)] * 10, 25.0)
    outcome = ringlight("poses", tmp_path / "night.mp4", "--quiet")
    assert outcome.code == 1
    assert "night.mp4: shows nothing in any of its 10 frames" in outcome.err


@pytest.mark.slow
def test_train_finds_the_cameras_first(tmp_path: Path, ringlight: Command):
    """And says whatever is to be said of them; the scene that it makes is the run's."""
    save_photographs(tmp_path / "my photos", 7)
    quick = ("3dgs", "--steps", "2", "--lpips", "--threads", "1", "--out", tmp_path / "run", "--json")
    offered = ringlight("train", tmp_path / "my photos", *quick)
    assert offered.code == 1
    assert "ringlight poses" in offered.err
    assert "--poses auto" in offered.err
    posed = ringlight("poses", tmp_path / "my photos", "--lens", "simple-pinhole", "--json", "--quiet")
    assert (posed.code, posed.err.splitlines()) == (0, [])
    report = json.loads(posed.out)
    assert report["registered"] == 7
    assert report["scene"] == str(tmp_path / "my photos-scene")
    outcome = ringlight("train", tmp_path / "my photos-scene", "--poses", "auto", *quick)
    assert outcome.code == 0, outcome.err
    assert json.loads(outcome.out)["iterations"] == 2


@pytest.mark.slow
@pytest.mark.parametrize("number", [signal.SIGTERM, signal.SIGINT])
def test_a_signal_ends_it_in_order_and_leaves_no_process(number: int, tmp_path: Path):
    save_photographs(tmp_path / "photos", 12)
    words = [sys.executable, "-m", "ringlight", "poses", tmp_path / "photos", tmp_path / "out", "--threads", "1"]
    running = subprocess.Popen(list(map(str, words)), stderr=subprocess.PIPE, stdout=subprocess.PIPE, text=True)
    until = time.monotonic() + 60
    while time.monotonic() < until and not (tmp_path / "out" / "poses" / "colmap.log").exists():
        time.sleep(0.01)
    assert holders(tmp_path)
    os.kill(running.pid, number)
    out, err = running.communicate(timeout=60)
    assert (running.returncode, out) == (128 + number, "")
    assert f"stopped; go on with: ringlight poses {tmp_path / 'photos'} {tmp_path / 'out'}\n" in err
    assert "Aborted" not in err
    # A signal while it is started leaves it to see that its input closed.
    until = time.monotonic() + 10
    while time.monotonic() < until and holders(tmp_path):
        time.sleep(0.01)
    assert not holders(tmp_path), "COLMAP's process has ended"


@pytest.mark.slow
def test_cameras_of_a_film(tmp_path: Path, ringlight: Command):
    frames = [torch.tensor(photograph(shot) / 255, dtype=torch.float32) for shot in shots(60)]
    write_video(tmp_path / "walk.mp4", frames, 25.0)
    outcome = ringlight("poses", tmp_path / "walk.mp4", "--json", "--threads", "1")
    assert outcome.code == 0, outcome.err
    report = json.loads(outcome.out)
    assert 5 <= report["photographs"] <= 60
    assert report["registered"] == report["photographs"]
    assert report["reprojection_error"] < 1
    assert report["matching"].startswith("neighbours")
    assert (tmp_path / "walk-scene" / "sparse" / "0" / "cameras.bin").exists()
