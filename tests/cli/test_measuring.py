"""Measuring a run: no newer report is lost to an older one, and no number to a place that cannot be written to."""

import json
import shlex
import shutil
import threading
from collections.abc import Iterator
from pathlib import Path

import pytest
import torch
from cli_session import QUICK
from command import Command
from refusal import refused, snapshot
from safetensors.torch import save_file

from ringlight.cli import checks
from ringlight.cli.main import run as run_command
from ringlight.errors import OutputError
from ringlight.files import lpips_weights
from ringlight.fit.train import Progress
from ringlight.measure.lpips import tensor_shapes, weights_path
from ringlight.runs import finish, kept_pictures, lock
from ringlight.runs.session import Session

needs_locks = pytest.mark.skipif(lock.fcntl is None, reason="needs locks on files")


def iterations(run: Path) -> int:
    return int(json.loads((run / "report.json").read_text())["iterations"])


@needs_locks
def test_a_run_that_is_measured_while_it_trains_keeps_the_report_of_its_end(
    tiny: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    run = tmp_path / "run"
    steps, measure = Session.steps, finish.measure
    measuring, trained = threading.Event(), threading.Event()
    codes: list[int] = []

    def slow_to_measure(*given: object, **options: object) -> object:
        report = measure(*given, **options)  # type: ignore[arg-type]
        if threading.current_thread() is evaluation:
            measuring.set()
            assert trained.wait(60)
        return report

    def measured_at_fifteen(session: Session) -> Iterator[Progress]:
        for progress in steps(session):
            yield progress
            if progress.step == 15:
                evaluation.start()
                assert measuring.wait(60)

    evaluation = threading.Thread(target=lambda: codes.append(run_command(["eval", str(run), "--lpips", "--quiet"])))
    monkeypatch.setattr(finish, "measure", slow_to_measure)
    monkeypatch.setattr(Session, "steps", measured_at_fifteen)
    assert run_command(["train", str(tiny), "3dgs", "--out", str(run), *QUICK, "--save-every", "0.0001"]) == 0
    ended = snapshot(run)
    trained.set()
    evaluation.join(60)
    assert codes == [0]
    assert iterations(run) == 40
    assert snapshot(run) == ended
    told = capsys.readouterr()
    assert "stopped at step 15 of 40" in told.out
    assert "is training or measuring this run; nothing is written" in told.err


@needs_locks
def test_a_run_is_not_trained_while_it_is_measured(
    trained: dict[str, Path], tmp_path: Path, ringlight: Command, monkeypatch: pytest.MonkeyPatch
) -> None:
    run = Path(shutil.copytree(trained["3dgs"], tmp_path / "run"))
    measure, codes = finish.measure, []

    def resumed(*given: object, **options: object) -> object:
        codes.append(run_command(["train", "--resume", str(run)]))
        return measure(*given, **options)  # type: ignore[arg-type]

    monkeypatch.setattr(finish, "measure", resumed)
    done = ringlight("eval", run, "--lpips", "--quiet")
    assert (done.code, codes) == (0, [1])
    assert "is training or measuring this run; wait" in done.err
    assert ringlight("train", "--resume", run, "--quiet").code == 0


def test_a_report_of_a_later_step_stays_where_nothing_can_be_locked(
    trained: dict[str, Path], tmp_path: Path, ringlight: Command, monkeypatch: pytest.MonkeyPatch
) -> None:
    run = Path(shutil.copytree(trained["3dgs"], tmp_path / "run"))
    report = json.loads((run / "report.json").read_text())
    later = json.dumps(report | {"iterations": 41})
    measure = finish.measure

    def overtaken(*given: object, **options: object) -> object:
        (run / "report.json").write_text(later)
        return measure(*given, **options)  # type: ignore[arg-type]

    monkeypatch.setattr(lock, "fcntl", None)
    with monkeypatch.context() as patched:
        patched.setattr(finish, "measure", overtaken)
        done = ringlight("eval", run, "--lpips", "--quiet")
    assert (done.code, (run / "report.json").read_text()) == (1, later)
    assert "PSNR" in done.out
    refused(ringlight("eval", run, "--lpips", "--quiet"), 1, "step 41", "step 40", "--out")
    assert (run / "report.json").read_text() == later


@pytest.mark.parametrize("module", [finish, kept_pictures])
def test_numbers_are_shown_where_they_cannot_be_kept(
    module: object, trained: dict[str, Path], tmp_path: Path, ringlight: Command, monkeypatch: pytest.MonkeyPatch
) -> None:
    run = Path(shutil.copytree(trained["3dgs"], tmp_path / "run"))
    before = snapshot(run)

    def refuses(path: Path, *content: object) -> None:
        raise OutputError(f"{path}: cannot be written: permission is denied; choose a folder you may read and write")

    monkeypatch.setattr(module, "write_text" if module is finish else "save_image", refuses)
    done = ringlight("eval", run, "--lpips", "--quiet", "--json")
    assert done.code == 1
    assert json.loads(done.out)["iterations"] == 40
    assert "permission is denied" in done.err
    if module is kept_pictures:
        assert snapshot(run) == before


# at the end of a training


def test_a_failed_measurement_says_that_the_model_is_saved(
    scene_copy: Path, tmp_path: Path, ringlight: Command, monkeypatch: pytest.MonkeyPatch
) -> None:
    image = scene_copy / "test" / "r_1.png"
    whole, run = image.read_bytes(), tmp_path / "my run"
    steps = Session.steps

    def damaged_on_the_way(session: Session) -> Iterator[Progress]:
        yield from steps(session)
        image.write_bytes(whole[:150])

    with monkeypatch.context() as patched:
        patched.setattr(Session, "steps", damaged_on_the_way)
        sentence = refused(ringlight("train", scene_copy, "3dgs", "--out", run, *QUICK), 1, image, "the model is saved")
    assert (run / "model.safetensors").is_file()
    way = shlex.split(sentence.partition("measure it with: ")[2])
    assert way == ["ringlight", "eval", str(run)]
    image.write_bytes(whole)
    assert ringlight(*way[1:], "--lpips", "--quiet").code == 0
    assert iterations(run) == 40


@pytest.mark.parametrize(
    "error", [OSError(5, "Input/output error", "r_0.png"), MemoryError(), OutputError("full: free some space")]
)
def test_whatever_fails_while_measuring_the_model_is_saved(
    error: Exception, tiny: Path, tmp_path: Path, ringlight: Command, monkeypatch: pytest.MonkeyPatch
) -> None:
    def fails(*given: object, **options: object) -> None:
        raise error

    monkeypatch.setattr(finish, "measure", fails)
    refused(ringlight("train", tiny, "3dgs", "--out", tmp_path / "run", *QUICK), 1, "the model is saved", "eval")
    assert (tmp_path / "run" / "model.safetensors").is_file()


@pytest.fixture
def damaged_weights(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.setenv("RINGLIGHT_CACHE", str(tmp_path))
    path = weights_path("alex")
    save_file({name: torch.zeros(shape) for name, shape in tensor_shapes("alex").items()}, path)
    path.write_bytes(path.read_bytes()[:-1000])
    return path


def test_damaged_weights_of_lpips_leave_its_column_open(
    damaged_weights: Path, trained: dict[str, Path], tmp_path: Path, ringlight: Command
) -> None:
    run = Path(shutil.copytree(trained["3dgs"], tmp_path / "run"))
    done = ringlight("eval", run, "--quiet")
    assert done.code == 0
    assert f"warning: {damaged_weights}: cannot be read" in done.err
    assert "weights are damaged" in " ".join(done.out.split())
    assert json.loads((run / "report.json").read_text())["lpips_alex"] is None
    damaged_weights.unlink()
    compared = " ".join(ringlight("compare", run).out.split())
    assert "was not measured in these runs; measure it with 'ringlight eval RUN'" in compared


def test_the_doctor_tells_damaged_weights(damaged_weights: Path) -> None:
    found = {finding.name: finding for finding in checks._lpips()}
    assert (found["LPIPS alex"].state, found["LPIPS alex"].detail) == ("problem", "weights are damaged")
    assert found["LPIPS alex"].remedy == "ringlight fetch-lpips"
    assert found["LPIPS vgg"].state == "missing"


def test_damaged_weights_are_fetched_again(
    damaged_weights: Path, ringlight: Command, monkeypatch: pytest.MonkeyPatch
) -> None:
    fetched: list[Path] = []
    weights = {name: torch.zeros(shape) for name, shape in tensor_shapes("vgg").items()}
    save_file(weights, weights_path("vgg"))
    monkeypatch.setattr(lpips_weights, "fetch_lpips", lambda folder, *_: fetched.append(folder) or [])
    assert ringlight("fetch-lpips").code == 0
    assert fetched == [damaged_weights.parent]


def test_settings_that_were_given_stand_in_the_report_and_stay_there(run_folder: Path, tmp_path: Path) -> None:
    def settings(folder: Path) -> dict[str, dict[str, str]] | None:
        found: dict[str, dict[str, str]] | None = json.loads((folder / "report.json").read_text())["settings"]
        return found

    of_training = settings(run_folder)
    assert of_training is not None
    assert of_training["steps"] == {"value": str(iterations(run_folder)), "default": "30000"}
    assert "seed" not in of_training
    (run_folder / "report.json").unlink()
    assert run_command(["eval", str(run_folder)]) == 0
    assert settings(run_folder) == of_training
    alone = shutil.copy(run_folder / "model.safetensors", tmp_path)
    assert run_command(["eval", str(alone), "--out", str(tmp_path / "alone")]) == 0
    assert settings(tmp_path / "alone") is None
