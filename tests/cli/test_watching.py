"""What is seen while a run trains: pictures of one view, curves, events; none of it changes a bit."""

import errno
import json
import shutil
import signal
from pathlib import Path

import pytest
from cli_session import QUICK
from command import Command
from refusal import QUIET, refused
from scenes_on_disk import picture

from ringlight.files.tensor_file import read_metadata


def curve(run: Path) -> list[dict]:
    found: list[dict] = json.loads((run / "report.json").read_text())["curve"]
    return found


def untimed(points: list[dict]) -> list[dict]:
    return [{name: value for name, value in point.items() if name != "seconds"} for point in points]


def test_previews_show_one_view_and_change_no_bit(
    tiny: Path, trained: dict[str, Path], tmp_path: Path, ringlight: Command
) -> None:
    run = tmp_path / "run"
    words = [word for word in QUICK if word != "--quiet"]
    done = ringlight("train", tiny, "3dgs", "--out", run, "--preview", "15", *words)
    assert done.code == 0, done.err
    assert f"test view test/r_0.png, in {run / 'previews'}" in done.err
    names = sorted(path.name for path in (run / "previews").iterdir())
    assert names == ["step-000015.png", "step-000030.png", "step-000040.png"]
    shown = [picture(run / "previews" / name) for name in names]
    assert shown[0].shape == (20, 20, 3)
    assert (shown[0] != shown[1]).any()
    last = next((run / "images" / "test").glob("*r_0*"))
    assert (shown[2] == picture(last)).all(), "the last is the picture that was measured"
    for name in ("model.safetensors",):
        assert (run / name).read_bytes() == (trained["3dgs"] / name).read_bytes()
    assert untimed(curve(run)) == untimed(curve(trained["3dgs"]))


def test_the_progress_line_names_the_last_preview(
    tiny: Path, tmp_path: Path, ringlight: Command, monkeypatch: pytest.MonkeyPatch
) -> None:
    for pause in ("FIRST_LOG_SECONDS", "LOG_SECONDS"):
        monkeypatch.setattr(f"ringlight.cli.progress.{pause}", 0.0)
    words = [word for word in QUICK if word != "--quiet"]
    done = ringlight("train", tiny, "3dgs", "--out", tmp_path / "run", "--preview", "15", *words)
    lines = {int(line.split()[1].split("/")[0]): line for line in done.err.splitlines() if line.startswith("step ")}
    assert "previews" not in lines[14]
    assert "  preview 15  " in lines[16]
    assert "  preview 40  " in lines[40]


def test_a_preview_that_is_no_number_of_steps_is_refused(tiny: Path, tmp_path: Path, ringlight: Command) -> None:
    words = ("train", tiny, "3dgs", "--out", tmp_path / "run", "--preview", "-1", *QUIET)
    refused(ringlight(*words), 1, "--preview", "-1")
    assert not (tmp_path / "run").exists()


@pytest.mark.parametrize("flag", [("--port", "0"), ("--host", "0.0.0.0")])
def test_an_address_without_a_page_is_refused(
    flag: tuple[str, str], tiny: Path, tmp_path: Path, ringlight: Command
) -> None:
    refused(ringlight("train", tiny, "3dgs", "--out", tmp_path / "run", *flag, *QUICK), 1, flag[0], "--view")
    assert not (tmp_path / "run").exists()


def test_a_preview_that_cannot_be_written_costs_no_step(
    trained: dict[str, Path], tmp_path: Path, ringlight: Command
) -> None:
    run = Path(shutil.copytree(trained["3dgs"], tmp_path / "run"))
    (run / "previews").write_text("in the way")
    done = ringlight("train", "--resume", run, "--steps", "10", "--preview", "2", *QUIET)
    assert done.code == 0, done.err
    said = [line for line in done.err.splitlines() if "previews" in line]
    assert len(said) == 1
    assert str(run / "previews") in said[0]
    assert "goes on without" in said[0]
    assert json.loads((run / "report.json").read_text())["iterations"] == 50


def test_a_curve_is_kept_and_goes_on_where_a_run_was_stopped(
    tiny: Path, trained: dict[str, Path], tmp_path: Path, ringlight: Command, at_step
) -> None:
    points = curve(trained["3dgs"])
    assert [point["step"] for point in points] == list(range(1, 41))
    assert points[-1]["psnr"] > points[0]["psnr"]
    seconds = [point["seconds"] for point in points]
    assert seconds == sorted(seconds)
    assert len({point["counted"] for point in points}) > 1, "density control was at work"
    at_step(15, lambda _: signal.raise_signal(signal.SIGINT))
    run = tmp_path / "run"
    assert ringlight("train", tiny, "3dgs", "--out", run, *QUICK).code == 130
    assert ringlight("train", "--resume", run, *QUIET).code == 0
    assert untimed(curve(run)) == untimed(points)
    measured = ringlight("eval", run, *QUIET)
    assert measured.code == 0
    assert curve(run), "eval keeps what train knew"
    assert ringlight("train", "--resume", run, "--steps", "5", *QUIET).code == 0
    assert [point["step"] for point in curve(run)] == list(range(1, 46))


def test_curves_are_drawn(trained: dict[str, Path], tmp_path: Path, ringlight: Command) -> None:
    path = tmp_path / "curves.png"
    done = ringlight("compare", trained["3dgs"], trained["ringlight-basis"], "--curves", path)
    assert done.code == 0, done.err
    assert str(path) in done.err
    assert picture(path).shape[1] > 3 * 500
    refused(ringlight("compare", trained["3dgs"], "--curves", path), 1, path, "--overwrite")
    refused(ringlight("compare", trained["3dgs"], "--curves", tmp_path / "c.jpg"), 1, "PNG")
    old = Path(shutil.copytree(trained["3dgs"], tmp_path / "old"))
    report = json.loads((old / "report.json").read_text())
    del report["curve"]
    (old / "report.json").write_text(json.dumps(report))
    refused(ringlight("compare", old, "--curves", tmp_path / "none.png"), 1, "how its training went")
    assert not (tmp_path / "none.png").exists()


def test_events_for_tensorboard(tiny: Path, trained: dict[str, Path], tmp_path: Path, ringlight: Command) -> None:
    pytest.importorskip("tensorboard", reason="the [tensorboard] extra is not installed")
    from tensorboard.backend.event_processing.event_accumulator import EventAccumulator

    run = tmp_path / "run"
    words = ("--tensorboard", "--preview", "20", "--eval-at", "10")
    assert ringlight("train", tiny, "3dgs", "--out", run, *words, *QUICK).code == 0
    events = EventAccumulator(str(run / "tensorboard")).Reload()
    shown = events.Scalars("training/psnr")
    points = curve(run)
    assert [event.step for event in shown] == [point["step"] for point in points]
    assert [event.value for event in shown] == pytest.approx([point["psnr"] for point in points], rel=1e-5)
    assert events.Tags()["images"] == ["preview"]
    assert (run / "model.safetensors").read_bytes() == (trained["3dgs"] / "model.safetensors").read_bytes()


def test_without_tensorboard_the_remedy_is_named(
    tiny: Path, tmp_path: Path, ringlight: Command, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setitem(__import__("sys").modules, "torch.utils.tensorboard", None)
    words = ("train", tiny, "3dgs", "--out", tmp_path / "run", "--tensorboard", *QUICK)
    refused(ringlight(*words), 1, "ringlight[tensorboard]")
    assert not (tmp_path / "run").exists()


def test_events_that_cannot_be_written_cost_no_step(
    trained: dict[str, Path], tmp_path: Path, ringlight: Command, at_step
) -> None:
    pytest.importorskip("tensorboard", reason="the [tensorboard] extra is not installed")
    run = Path(shutil.copytree(trained["3dgs"], tmp_path / "run"))
    at_step(43, lambda session: shutil.rmtree(run / "tensorboard"))
    words = ("--steps", "10", "--tensorboard", "--preview", "2", "--eval-at", "49")
    done = ringlight("train", "--resume", run, *words, *QUIET)
    assert done.code == 0, done.err
    assert "Traceback" not in done.err
    assert [line for line in done.err.splitlines() if "tensorboard" in line] == [
        f"warning: {run / 'tensorboard'}: cannot be written (No such file or directory); "
        "training goes on without tensorboard"
    ]
    assert json.loads((run / "report.json").read_text())["iterations"] == 50


def test_events_that_cannot_begin_cost_no_step(trained: dict[str, Path], tmp_path: Path, ringlight: Command) -> None:
    pytest.importorskip("tensorboard", reason="the [tensorboard] extra is not installed")
    run = Path(shutil.copytree(trained["3dgs"], tmp_path / "run"))
    shutil.rmtree(run / "tensorboard", ignore_errors=True)
    (run / "tensorboard").write_text("a file")
    done = ringlight("train", "--resume", run, "--steps", "2", "--tensorboard", *QUIET)
    assert done.code == 0, done.err
    assert "training goes on without tensorboard" in done.err
    assert json.loads((run / "report.json").read_text())["iterations"] == 42


def test_events_that_are_refused_at_the_end_cost_no_model(
    trained: dict[str, Path], tmp_path: Path, ringlight: Command, monkeypatch: pytest.MonkeyPatch
) -> None:
    writer = pytest.importorskip(
        "torch.utils.tensorboard", reason="the [tensorboard] extra is not installed", exc_type=ImportError
    )

    def full(_: object) -> None:
        raise OSError(errno.ENOSPC, "No space left on device")

    monkeypatch.setattr(writer.SummaryWriter, "flush", full)
    monkeypatch.setattr(writer.FileWriter, "flush", full)
    run = Path(shutil.copytree(trained["3dgs"], tmp_path / "run"))
    done = ringlight("train", "--resume", run, "--steps", "2", "--tensorboard", *QUIET)
    assert done.code == 0, done.err
    assert done.err.count("cannot be written (No space left on device)") == 1
    assert json.loads((run / "report.json").read_text())["iterations"] == 42


def test_a_test_photograph_that_is_gone_costs_no_step(
    scene_copy: Path, tmp_path: Path, ringlight: Command, at_step
) -> None:
    run = tmp_path / "run"
    words = ("--eval-at", "15", "--photo-memory", "0", *(word for word in QUICK if word != "--quiet"))
    at_step(10, lambda session: shutil.rmtree(scene_copy / "test"))
    ended = ringlight("train", scene_copy, "3dgs", "--out", run, *words)
    assert "warning: step 15: the test views cannot be measured: " in ended.err
    assert "the model is saved, measure it with" in ended.err
    assert read_metadata(run / "checkpoint.safetensors")["step"] == "40"


def test_test_views_are_measured_where_nothing_is_said_of_them(tiny: Path, tmp_path: Path, ringlight: Command) -> None:
    pytest.importorskip("tensorboard", reason="the [tensorboard] extra is not installed")
    from tensorboard.backend.event_processing.event_accumulator import EventAccumulator

    run = tmp_path / "run"
    done = ringlight("train", tiny, "3dgs", "--out", run, "--tensorboard", "--eval-at", "10", "30", *QUICK)
    assert "on the test views" not in done.err
    measured = EventAccumulator(str(run / "tensorboard")).Reload().Scalars("test/psnr")
    assert [event.step for event in measured] == [10, 30]


def test_steps_that_are_done_are_told_of(trained: dict[str, Path], tmp_path: Path, ringlight: Command) -> None:
    run = Path(shutil.copytree(trained["3dgs"], tmp_path / "run"))
    done = ringlight("train", "--resume", run, "--steps", "2", "--eval-at", "7", "40", "41", *QUIET)
    assert "warning: --eval-at 7 40 has no effect: the run goes on after step 40\n" in done.err


def test_what_watches_steps_is_told_of_where_none_is_left(
    trained: dict[str, Path], tmp_path: Path, ringlight: Command
) -> None:
    run = Path(shutil.copytree(trained["3dgs"], tmp_path / "run"))
    done = ringlight("train", "--resume", run, "--eval-at", "7", "40", "--preview", "5", "--save-every", "9", *QUIET)
    assert done.code == 0
    assert done.err.splitlines() == [
        f"warning: {flag} has no effect: no step is left to do"
        for flag in ("--eval-at 7 40", "--preview 5", "--save-every 9")
    ]
