"""What a command shows before it has a result: at once, on a terminal and in a log, and never what a file wrote."""

import os
import pty
import re
import select
import shutil
import subprocess
import sys
import time
from collections.abc import Iterator
from pathlib import Path

import pytest
from cli_session import QUICK
from command import Command
from PIL import Image
from scenes_on_disk import write_tiny_scene

from ringlight.cli import stages as module
from ringlight.cli.ineffective import start_without_effect
from ringlight.cli.main import run as run_command
from ringlight.cli.progress import spoken
from ringlight.cli.stages import StageLine, stages
from ringlight.cli.streams import Lasting
from ringlight.data.options import SceneOptions
from ringlight.methods.table import METHODS
from ringlight.runs import limits
from ringlight.runs.resume import resume_run

TALKATIVE = tuple(word for word in QUICK if word != "--quiet")


def on_a_terminal(*words: object, cwd: Path | None = None) -> tuple[int, str]:
    """Exit code and all that reaches a terminal of 100 columns on which the command runs."""
    ours, theirs = pty.openpty()
    command = [sys.executable, "-m", "ringlight", *map(str, words)]
    environment = os.environ | {"COLUMNS": "100", "TERM": "xterm"}
    with subprocess.Popen(command, stdin=theirs, stdout=theirs, stderr=theirs, env=environment, cwd=cwd) as process:
        os.close(theirs)
        shown = b""
        try:
            while part := os.read(ours, 65536):
                shown += part
        except OSError:  # the last one has closed it
            pass
        code = process.wait(60)
    os.close(ours)
    return code, shown.decode()


@pytest.fixture(scope="module")
def masked(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Enough masked photographs for a trial."""
    return write_tiny_scene(tmp_path_factory.mktemp("masked") / "masked", views=14)


def test_the_scene_is_told_before_anything_is_tried_on_it(
    masked: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    settled, told = limits.rasterizer_for, []

    def listening(device: str) -> object:
        told.append(capsys.readouterr().err)
        return settled(device)

    monkeypatch.setattr(module, "BETWEEN_SECONDS", 0.0)
    monkeypatch.setattr(limits, "rasterizer_for", listening)
    words = ("--steps", "3", "--lpips", "--out", str(tmp_path / "run"))
    assert run_command(["train", str(masked), "ringlight", *words]) == 0
    before, after = told[0], capsys.readouterr().err
    assert before.startswith(f"reading {masked}\n")
    assert "ringlight on masked (blender): " in before
    assert "photographs" in before
    later = "".join(told[1:]) + after
    assert re.search(r"^trying with and without reflections: \d+/6$", later, re.MULTILINE)
    assert "carving the first surface" in later
    assert re.search(
        r"^method: ringlight-\w+, for surfaces that .* photographs kept apart was .* dB", later, re.MULTILINE
    )


def test_on_a_terminal_the_trial_counts_and_leaves_no_line(masked: Path, tmp_path: Path) -> None:
    code, shown = on_a_terminal("train", masked, "ringlight", "--steps", "3", "--lpips", "--out", tmp_path / "run")
    assert code == 0, shown
    assert shown.startswith("ringlight train: starting\r\x1b[2Kreading ")
    assert re.search(r"trying with and without reflections  \[=* *\] \d+/6", shown)
    left = [line.rsplit("\x1b[2K", 1)[-1] for line in shown.split("\n")]
    assert not [line for line in left if re.match("trying|reading|carving|ringlight train: starting", line)]


def test_the_shortest_run_shows_no_number_that_is_none(masked: Path, tmp_path: Path) -> None:
    code, shown = on_a_terminal("train", masked, "3dgs", "--steps", "1", "--lpips", "--out", tmp_path / "run")
    assert code == 0, shown
    assert "1/1" in shown
    assert "nan" not in shown


def test_a_complaint_on_a_terminal_is_a_plain_sentence(tmp_path: Path) -> None:
    code, shown = on_a_terminal("info", tmp_path, "extra")
    assert code == 2
    said = shown.rsplit("\x1b[2K", 1)[-1].strip()
    assert said == "ringlight info: not understood: extra; see 'ringlight info --help'"


def test_a_folder_with_a_blank_in_its_name_needs_quotes(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    (tmp_path / "my run").mkdir()
    assert run_command(["info", "my", "run"]) == 2
    assert "not understood: run; a name with blanks needs quotes: 'my run'; see" in capsys.readouterr().err
    assert run_command(["info", "x" * 5000, "run"]) == 2, "no name of a file"


@pytest.mark.parametrize("verb", ["export", "compress", "eval"])
def test_every_verb_that_takes_long_says_how_far_it_is(
    verb: str, trained: dict[str, Path], tmp_path: Path, ringlight: Command, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(module, "BETWEEN_SECONDS", 0.0)
    run = Path(shutil.copytree(trained["ringlight-ring"], tmp_path / "run"))
    words = {
        "export": ("export", run, tmp_path / "x.ply", "--fit-steps", "3"),
        "compress": ("compress", run, tmp_path / "x.safetensors"),
        "eval": ("eval", run, "--lpips"),
    }[verb]
    stages = {
        "export": "fitting colours to the model's pictures",
        "compress": "packing",
        "eval": "measuring views",
    }
    done = ringlight(*words)
    assert done.code == 0, done.err
    assert done.err.startswith(f"reading {run}\n")
    assert re.search(rf"^{stages[verb]}: \d+/\d+$", done.err, re.MULTILINE)


def test_a_log_gets_a_line_a_stage_and_then_only_now_and_then(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    now = [100.0]
    monkeypatch.setattr(time, "monotonic", lambda: now[0])
    line = StageLine(quiet=False)
    line("reading photos")
    for done in range(40):
        now[0] += 0.5
        line("trying", done, 40)
    assert capsys.readouterr().err == "reading photos\ntrying: 1/40\ntrying: 21/40\n"
    StageLine(quiet=True)("reading photos")
    assert capsys.readouterr().err == ""


@pytest.mark.parametrize(
    ("seconds", "said"), [(3.4, "3 s"), (89.0, "89 s"), (720.0, "12 min"), (5399.0, "90 min"), (12600.0, "3.5 h")]
)
def test_times_are_said_as_people_do(seconds: float, said: str) -> None:
    assert spoken(seconds) == said


# names of strangers


HOSTILE = "balls\x1b[1A\x1b[2K\rall is well"


def test_no_name_moves_the_cursor_of_a_terminal(tiny: Path, trained: dict[str, Path], tmp_path: Path) -> None:
    scene = Path(shutil.copytree(tiny, tmp_path / HOSTILE))
    words = ("--steps", "2", "--initial-points", "50", "--lpips", "--out", tmp_path / "run")
    code, shown = on_a_terminal("train", scene, "3dgs", *words)
    assert code == 0, shown
    assert HOSTILE not in shown
    assert r"balls\x1b[1A\x1b[2K\rall is well" in shown
    for verb in (("info", tmp_path / "run"), ("compare", tmp_path / "run", trained["3dgs"])):
        code, shown = on_a_terminal(*verb)
        assert code == 0, shown
        assert "\x1b[1A" not in shown
        assert r"balls\x1b" in shown


@pytest.fixture
def terminal() -> Iterator[tuple[Lasting, int]]:
    """A terminal, and where what it shows can be read."""
    ours, theirs = pty.openpty()
    with os.fdopen(theirs, "w") as screen:
        yield Lasting(screen), ours
    os.close(ours)


def shown_until(text: str, ours: int) -> str:
    """All that is shown until ``text`` comes, which it must within a minute."""
    shown = ""
    while text not in shown:
        assert select.select([ours], [], [], 60)[0], f"shows {shown!r} and no more"
        shown += os.read(ours, 65536).decode()
    return shown


def test_what_cannot_be_counted_shows_how_long_it_takes(
    terminal: tuple[Lasting, int], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(sys, "stderr", terminal[0])
    monkeypatch.setattr(module, "TICK_SECONDS", 0.01)
    with stages(quiet=False) as line:
        line("loading")
        shown_until("loading  0 s", terminal[1])
        shown_until("loading  0 s", terminal[1])
        line("counting", 1, 5)
        line("writing")
        assert "counting  0 s" not in shown_until("writing  0 s", terminal[1])


def test_the_clock_leaves_alone_what_was_written(terminal: tuple[Lasting, int]) -> None:
    stream, ours = terminal
    stream.draw("loading")
    assert stream.redraw("loading", "loading  1 s")
    stream.write("a warning\n")
    assert not stream.redraw("loading  1 s", "loading  2 s")
    stream.draw("another's")
    assert not stream.redraw("loading  1 s", "loading  2 s")
    stream.write("the end\n")
    assert shown_until("the end\r\n", ours).endswith("a warning\r\nanother's\r\x1b[2Kthe end\r\n")


def test_help_keeps_its_colours_on_a_terminal() -> None:
    code, shown = on_a_terminal("eval", "--help")
    assert code == 0
    assert "\x1b[" in shown
    assert r"\x1b" not in shown


# what must not be missed


def test_warnings_of_a_scene_are_no_progress(
    tiny: Path, tmp_path: Path, ringlight: Command, monkeypatch: pytest.MonkeyPatch
) -> None:
    from ringlight.core.scene import WARNING
    from ringlight.data import blender

    warned = f"{WARNING}COLMAP split the photographs into 3 models"
    scene_from = blender.scene_from
    monkeypatch.setattr(
        blender,
        "scene_from",
        lambda capture, *rest: scene_from(blender.replace(capture, notes=(*capture.notes, warned)), *rest),
        raising=True,
    )
    monkeypatch.setattr(blender, "replace", __import__("dataclasses").replace, raising=False)
    run = tmp_path / "run"
    quick = ("--steps", "2", "--initial-points", "50", "--lpips", "--quiet")
    assert ringlight("train", tiny, "3dgs", "--out", run, *quick).err.startswith(f"{warned}\nwritten to")
    assert ringlight("eval", run, "--lpips", "--quiet").err == f"{warned}\n"
    assert ringlight("train", "--resume", run, "--quiet", "--lpips").err == f"{warned}\n"


def test_settings_without_effect_are_said_even_quietly(masked: Path, tmp_path: Path, ringlight: Command) -> None:
    words = ("--steps", "3", "--lpips", "--quiet", "--initial-points", "777")
    carved = ringlight("train", masked, "ringlight", "--shading", "mirror", *words, "--out", tmp_path / "a")
    assert carved.code == 0
    assert "warning: --initial-points 777 has no effect: the run begins with" in carved.err
    random = ringlight("train", masked, "3dgs", *words, "--points-seed", "4", "--out", tmp_path / "b")
    assert random.code == 0
    assert "has no effect" not in random.err


def test_a_start_on_the_hull_that_cannot_be_is_said(
    masked: Path, tiny: Path, trained: dict[str, Path], tmp_path: Path, ringlight: Command
) -> None:
    words = ("--steps", "3", "--lpips", "--quiet", "--initial-points", "300", "--start.points", "300")
    few = ringlight("train", tiny, "3dgs", *words, "--out", tmp_path / "few")
    assert "--start.points 300 has no effect: a surface is carved from 12 photographs or more" in few.err
    bare = _without_alpha(masked, tmp_path / "bare")
    said = ringlight("train", bare, "3dgs", *words, "--start.opacity", "0.4", "--out", tmp_path / "none").err
    for flag in ("--start.points 300", "--start.opacity 0.4"):
        assert f"warning: {flag} has no effect: a surface is carved from masks" in said
    again = ("--from", trained["3dgs"], "--out", tmp_path / "from")
    said = ringlight("train", masked, "3dgs", *words, *again).err
    for flag in ("--start.points 300", "--initial-points 300"):
        assert f"{flag} has no effect: the run starts from {trained['3dgs']}" in said
    random = ("--start.points", "0", "--start.opacity", "0.4", "--out", tmp_path / "random")
    assert (
        "--start.opacity 0.4 has no effect: --start.points is 0"
        in ringlight("train", masked, "3dgs", *words, *random).err
    )
    discs = ("--start.form", "discs", "--start.opacity", "0.4")
    assert "--start" not in ringlight("train", masked, "3dgs", *words, *discs, "--out", tmp_path / "discs").err
    said = ringlight("train", bare, "3dgs", *words, *discs, "--out", tmp_path / "no-discs").err
    assert "--start.form discs has no effect: a surface is carved from masks" in said
    carved = ringlight("train", masked, "3dgs", *words, "--start.opacity", "0.4", "--out", tmp_path / "carved")
    assert carved.code == 0
    assert "--start.points" not in carved.err, "though there are as many random points"
    assert "--start.opacity 0.4 has no effect: with fewer than 54 photographs Gaussians start as" in carved.err
    faint = ("--start.opacity", "0.4", "--out", tmp_path / "planes")
    planes = ringlight("train", bare, "3dgs-dr", *words[:-2], *faint)
    assert planes.code == 0
    assert "has no effect" not in planes.err, "points without a hull have normals here, and so discs"
    usual = ringlight("train", bare, "3dgs", *words[:-2], "--out", tmp_path / "usual")
    assert "has no effect" not in usual.err, "nothing was asked for"


@pytest.mark.parametrize(
    ("method", "flags", "place"),
    [
        ("3dgs", (), ", on random points;"),
        ("3dgs", ("--start.points", "300"), ", anywhere in the visual hull;"),
        ("3dgs", ("--start.points", "300", "--start.form", "discs"), ", on the visual hull;"),
        ("tensorf", ("--rays", "16"), " to start with;"),
    ],
)
def test_a_run_says_where_its_gaussians_start(
    method: str, flags: tuple[str, ...], place: str, masked: Path, tmp_path: Path, ringlight: Command
) -> None:
    quick = ("--steps", "1", "--lpips", "--initial-points", "300")
    said = ringlight("train", masked, method, *quick, *flags, "--out", tmp_path / "run")
    (line,) = [line for line in said.err.splitlines() if "to start with" in line]
    assert place in line


def test_gaussians_of_a_model_start_where_they_lie(
    masked: Path, trained: dict[str, Path], tmp_path: Path, ringlight: Command
) -> None:
    quick = ("--steps", "1", "--lpips", "--from", trained["3dgs"])
    assert " to start with;" in ringlight("train", masked, "3dgs", *quick, "--out", tmp_path / "run").err


def test_a_method_without_points_says_so(masked: Path, tmp_path: Path, ringlight: Command) -> None:
    quick = ("--steps", "1", "--lpips", "--quiet", "--rays", "16", "--initial-points", "300")
    said = ringlight("train", masked, "tensorf", *quick, "--out", tmp_path / "run").err
    assert "warning: --initial-points 300 has no effect: tensorf starts from no points\n" in said


def test_idle_settings_are_said_before_anything_is_read(tmp_path: Path, ringlight: Command) -> None:
    (tmp_path / "empty").mkdir()
    said = ringlight("train", tmp_path / "empty", "3dgs", "--densify.mcmc.noise", "0").err
    assert said.startswith("warning: --densify.mcmc.noise 0 has no effect: --densify.kind is adaptive\n")


def test_settings_of_the_other_kind_of_density_control_are_said(tiny: Path, tmp_path: Path, ringlight: Command) -> None:
    words = ("--steps", "3", "--lpips", "--quiet", "--initial-points", "300")
    other = ("--densify.threshold", "1e-3", "--densify.no-pixel-bound", "--densify.every", "50")
    said = ringlight("train", tiny, "3dgs", *words, *other, "--densify.kind", "mcmc", "--out", tmp_path / "a").err
    assert "warning: --densify.threshold 0.001 has no effect: --densify.kind is mcmc\n" in said
    assert "warning: --densify.no-pixel-bound has no effect: --densify.kind is mcmc\n" in said
    assert "--densify.every" not in said
    adaptive = ringlight("train", tiny, "3dgs", *words, "--densify.mcmc.noise", "0", "--out", tmp_path / "b").err
    assert "warning: --densify.mcmc.noise 0 has no effect: --densify.kind is adaptive\n" in adaptive
    usual = ringlight("train", tiny, "ringlight-basis", *words, "--densify.kind", "mcmc", "--out", tmp_path / "c").err
    assert "has no effect: --densify" not in usual, "what the method itself sets was not asked for"


def _without_alpha(scene: Path, copy: Path) -> Path:
    shutil.copytree(scene, copy)
    for path in copy.glob("*/*.png"):
        with Image.open(path) as photograph:
            opaque = photograph.convert("RGB")
        opaque.save(path)
    return copy


def test_points_of_a_scene_take_the_effect_of_both_flags(trained: dict[str, Path]) -> None:
    session = resume_run(trained["3dgs"])
    scene = session.scene
    object.__setattr__(scene, "points", type(scene.points)(scene.points.positions, scene.points.colors))
    said = start_without_effect(SceneOptions(initial_points=5, points_seed=2), METHODS["3dgs"], session)
    assert [sentence.split(" has no effect: the scene brings")[0] for sentence in said] == [
        "--initial-points 5",
        "--points-seed 2",
    ]
    assert start_without_effect(SceneOptions(), METHODS["3dgs"], session) == []
