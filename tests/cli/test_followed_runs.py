"""A run that another process trains is followed, whatever becomes of its files."""

import os
import shutil
import time
from pathlib import Path

import numpy as np
import pytest
import torch
from cli_session import QUICK
from command import Command
from recorded_page import Clock, RecordedPage, standing

from ringlight.errors import ModelFileError
from ringlight.files.atomic import written_atomically
from ringlight.view.on_disk import LOOK_SECONDS, Following, OnDisk
from ringlight.view.open import open_subject
from ringlight.view.viewer import Viewer, first_wishes


@pytest.fixture
def run(trained: dict[str, Path], tmp_path: Path) -> Path:
    return Path(shutil.copytree(trained["3dgs"], tmp_path / "run"))


def other(tiny: Path, folder: Path, ringlight: Command) -> Path:
    """A run of as many steps with another seed."""
    assert ringlight("train", tiny, "3dgs", "--out", folder / "other", "--seed", "5", *QUICK).code == 0
    return folder / "other"


def write_again(source: Path, target: Path) -> None:
    """As a training does: under another name first."""
    with written_atomically(target) as file:
        file.write(source.read_bytes())


class Looking:
    def __init__(self, *paths: Path):
        found = open_subject(list(paths), None, "cpu")
        self.page, self.clock = RecordedPage(), Clock()
        self.wishes = first_wishes(found.subject)
        self.viewer = Viewer(found.subject, self.page, self.wishes, None, self.clock, found.files)
        self.camera = next(iter(found.subject.views.values()))
        self.wishes.stand(0, standing(self.camera, 32, 24), self.clock())

    def rest(self) -> np.ndarray:
        for _ in range(60):
            self.clock.seconds += LOOK_SECONDS
            if not self.viewer.turn() and not self.viewer.is_moving:
                return self.page.pictures[-1][1]
        raise AssertionError("there is always something to do")


def test_a_model_that_is_written_again_is_shown_and_said(
    run: Path, tiny: Path, tmp_path: Path, ringlight: Command
) -> None:
    looking, newer = Looking(run), other(tiny, tmp_path, ringlight)
    before = looking.rest()
    assert looking.page.sentences == []
    write_again(newer / "model.safetensors", run / "model.safetensors")
    after = looking.rest()
    (sentence,) = looking.page.sentences
    assert sentence[0] == 0
    assert "another process has written it" in sentence[1]
    assert "step 40" in sentence[1]
    assert not sentence[2]
    assert "read again at" in looking.page.states[-1][0]
    assert (before != after).any()
    fresh = Looking(newer)
    assert (fresh.rest() == after).all()
    drawn = len(looking.page.pictures)
    looking.rest()
    assert (len(looking.page.pictures), len(looking.page.sentences)) == (drawn, 1), "nothing changed"


def test_the_models_beside_it_stay(run: Path, trained: dict[str, Path], tiny: Path, tmp_path: Path, ringlight: Command):
    looking, newer = Looking(trained["3dgs"], run), other(tiny, tmp_path, ringlight)
    before = looking.rest()
    write_again(newer / "model.safetensors", run / "model.safetensors")
    after = looking.rest()
    assert (before[:, :15] == after[:, :15]).all()
    assert (before[:, 17:] != after[:, 17:]).any()


def test_a_damaged_or_missing_model_is_one_sentence_and_the_old_one_stays(run: Path) -> None:
    looking, model = Looking(run), run / "model.safetensors"
    whole = model.read_bytes()
    before = looking.rest()
    model.write_bytes(whole[:-100])
    looking.rest()
    ((_, sentence, is_trouble),) = looking.page.sentences
    assert is_trouble
    assert str(model) in sentence
    model.unlink()
    looking.rest()
    assert len(looking.page.sentences) == 1
    looking.wishes.stand(0, standing(looking.camera, 33, 24), looking.clock())
    looking.wishes.stand(0, standing(looking.camera, 32, 24), looking.clock())
    assert (looking.rest() == before).all()
    write_again(run / "checkpoint.safetensors", model)  # whole, and no model
    looking.rest()
    assert [trouble for _, _, trouble in looking.page.sentences] == [True, True]
    model.write_bytes(whole)
    looking.rest()
    assert not looking.page.sentences[-1][2]
    assert (looking.page.pictures[-1][1] == before).all()


def test_nobody_looks_and_nothing_is_read(run: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    looking = Looking(run)
    looking.rest()
    looking.wishes.leave(0)
    monkeypatch.setattr(OnDisk, "take_model", lambda self: pytest.fail("read"))
    looking.rest()


def test_files_are_not_looked_at_all_the_time(run: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    looks = []
    following = Following({"run": OnDisk(run, "cpu")})
    monkeypatch.setattr(OnDisk, "take_model", lambda self: bool(looks.append(1)))
    for moment in np.arange(0.0, 10.0, 0.05):
        following.look(float(moment))
    assert 9 <= len(looks) <= 11


def test_a_finished_run_has_its_curve_and_a_model_file_none(run: Path) -> None:
    looking = Looking(run, run / "model.safetensors")
    (of_run, of_file) = looking.page.drawn[0].values()
    assert of_run.psnr_steps[-1] == 40
    assert len(of_run.loss) == len(of_run.psnr) == len(of_run.counted) > 5
    assert of_file.psnr_steps == ()


def test_a_curve_goes_on_while_the_run_does(run: Path, ringlight: Command) -> None:
    looking = Looking(run)
    looking.rest()
    drawn = len(looking.page.drawn)
    looking.rest()
    assert len(looking.page.drawn) == drawn
    time.sleep(0.02)  # so that no clock of a disk is too coarse
    assert ringlight("train", "--resume", run, "--steps", "10", "--quiet").code == 0
    looking.rest()
    assert looking.page.drawn[-1]["run"].psnr_steps[-1] == 50
    assert "step 50" in looking.page.states[-1][0]


def test_a_mark_is_taken_before_its_file_is_read(run: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """A model that comes while the one before it is read is read too."""
    file = OnDisk(run, "cpu")
    model = run / "model.safetensors"
    os.utime(model, (1, 1))
    read = OnDisk._read

    def read_late(self: OnDisk) -> object:
        found = read(self)
        os.utime(model, (2, 2))
        return found

    monkeypatch.setattr(OnDisk, "_read", read_late)
    assert file.take_model()
    monkeypatch.setattr(OnDisk, "_read", read)
    assert file.take_model()
    assert not file.take_model()


def test_a_damaged_model_raises_once(run: Path) -> None:
    file = OnDisk(run, "cpu")
    (run / "model.safetensors").write_bytes(b"damaged")
    with pytest.raises(ModelFileError):
        file.take_model()
    assert not file.take_model()
    assert torch.equal(file.background, torch.ones(3))
