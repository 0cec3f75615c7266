"""Commands run in this process, on a tiny scene, with models trained for a few steps once per session."""

import shutil
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest
from cli_session import QUICK, SMALL_LIGHT
from command import Command, Outcome
from scenes_on_disk import write_tiny_scene

from ringlight.cli.main import run
from ringlight.fit.train import Progress
from ringlight.runs.session import Session


@pytest.fixture
def ringlight(capsys: pytest.CaptureFixture[str]) -> Command:
    """Run one command: ``ringlight("info", folder)``."""

    def command(*words: object) -> Outcome:
        capsys.readouterr()
        code = run([str(word) for word in words])
        captured = capsys.readouterr()
        return Outcome(code, captured.out, captured.err)

    return command


@pytest.fixture(scope="session")
def tiny(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The scene; tests that damage it take a copy."""
    return write_tiny_scene(tmp_path_factory.mktemp("scene") / "balls")


@pytest.fixture(scope="session")
def trained(tiny: Path, tmp_path_factory: pytest.TempPathFactory) -> dict[str, Path]:
    """Finished runs by method; tests that write into one take a copy."""
    home = tmp_path_factory.mktemp("runs")
    runs = {}
    for method, flags in (("3dgs", ()), ("ringlight-basis", ()), ("ringlight-ring", SMALL_LIGHT)):
        runs[method] = home / method
        assert run(["train", str(tiny), method, "--out", str(runs[method]), *QUICK, *flags]) == 0
    return runs


@pytest.fixture
def run_folder(trained: dict[str, Path], tmp_path: Path) -> Path:
    """A copy of the RingLight run, to do with as one likes."""
    return Path(shutil.copytree(trained["ringlight-ring"], tmp_path / "run"))


@pytest.fixture
def scene_copy(tiny: Path, tmp_path: Path) -> Path:
    """A copy of the scene, to damage."""
    return Path(shutil.copytree(tiny, tmp_path / "balls"))


@pytest.fixture
def at_step(monkeypatch: pytest.MonkeyPatch) -> Callable[[int, Callable[[Session], object]], None]:
    """Have something happen after a step, before the command hears of it."""
    steps = Session.steps

    def plan(step: int, happen: Callable[[Session], object]) -> None:
        def eventful(session: Session) -> Iterator[Progress]:
            for progress in steps(session):
                if progress.step == step:
                    happen(session)
                yield progress

        monkeypatch.setattr(Session, "steps", eventful)

    return plan
