"""A scene whose photographs are all for training: every verb does what it can, and says what it cannot."""

import json
from pathlib import Path

import pytest
from cli_session import QUICK
from command import Command
from PIL import Image
from refusal import refused

ALL = ("--holdout-every", "0")


@pytest.fixture(scope="module")
def whole(tiny: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    from ringlight.cli.main import run

    folder = tmp_path_factory.mktemp("whole") / "run"
    assert run(["train", str(tiny), "3dgs", "--out", str(folder), *ALL, *QUICK, "--eval-at", "2"]) == 0
    return folder


def test_the_report_has_training_views_alone(whole: Path, tiny: Path):
    report = json.loads((whole / "report.json").read_text())
    assert report["split"] == "8 training, 0 test views"
    assert [report[name] for name in ("psnr", "psnr_u8", "psnr_pooled", "ssim_same", "lpips_alex")] == [None] * 5
    assert report["psnr_train"] > 5
    assert report["fps"] > 0
    assert report["images"] == []
    assert any("there are no test views" in note for note in report["notes"])
    assert len(list(tiny.glob("t*/*.png"))) == 8


def test_training_says_how_to_see_it_and_that_nothing_is_measured(tiny: Path, tmp_path: Path, ringlight: Command):
    run = tmp_path / "run"
    done = ringlight("train", tiny, "3dgs", "--out", run, *ALL, *QUICK, "--eval-at", "2")
    assert done.code == 0
    assert f"ringlight render {run} --path orbit" in done.err
    assert "has no test views." in done.out


def test_eval_and_info_and_compress_take_it(whole: Path, tmp_path: Path, ringlight: Command):
    told = ringlight("eval", whole, "--quiet", "--json", "--lpips")
    assert told.code == 0
    assert json.loads(told.out)["psnr"] is None
    assert ringlight("info", whole).code == 0
    small = ringlight("compress", whole, tmp_path / "small.safetensors", "--quiet")
    assert small.code == 0
    assert "not measured on photographs" in small.out


def test_compare_shows_that_nothing_was_measured(whole: Path, tmp_path: Path, ringlight: Command):
    shown = ringlight("compare", whole, "--markdown")
    assert shown.code == 0
    assert "has no test views." in shown.out
    [row] = [line for line in shown.out.splitlines() if line.startswith("| 3dgs")]
    assert row.split("|")[3].strip() == "-", row


def test_render_names_the_other_paths(whole: Path, tmp_path: Path, ringlight: Command):
    refused(ringlight("render", whole, "--out", tmp_path / "pictures"), 1, "no test views", "--path orbit")
    assert ringlight("render", whole, "--out", tmp_path / "pictures", "--path", "train").code == 0


def test_a_study_needs_test_views(tiny: Path, tmp_path: Path, ringlight: Command):
    refused(ringlight("study", "rank", tiny, *ALL, "--out", tmp_path), 1, "--holdout-every 0")


def test_a_run_knows_its_lists_and_masks_wherever_it_goes_on(
    tiny: Path, tmp_path: Path, ringlight: Command, monkeypatch: pytest.MonkeyPatch
):
    run, masks = tmp_path / "run", tmp_path / "cut"
    for path in tiny.glob("t*/*.png"):
        (masks / path.parent.name).mkdir(parents=True, exist_ok=True)
        with Image.open(path) as photograph:
            Image.new("L", photograph.size, 255).save(masks / path.parent.name / path.name)
    (tmp_path / "list.txt").write_text("train/r_0.png\ntrain/r_3.png\n")
    monkeypatch.chdir(tmp_path)
    asked = ("--masks", "cut", "--holdout", "list.txt")
    done = ringlight("train", tiny, "3dgs", *asked, "--out", run, *QUICK)
    assert done.code == 0, done.err
    first = json.loads((run / "report.json").read_text())
    assert first["split"] == "6 training, 2 test views"
    assert f"masks: {masks}/ (8 of 8 photographs)" in first["notes"]
    (tmp_path / "list.txt").unlink()
    (tmp_path / "elsewhere").mkdir()
    monkeypatch.chdir(tmp_path / "elsewhere")
    assert ringlight("eval", run, "--quiet", "--lpips").code == 0
    again = json.loads((run / "report.json").read_text())
    assert (again["split"], again["notes"], again["psnr"]) == (first["split"], first["notes"], first["psnr"])
    assert ringlight("train", "--resume", run, "--quiet", "--lpips").code == 0
