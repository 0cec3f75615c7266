"""What a new user met: remedies that help, commands that can be copied, words that are people's."""

import json
import shlex
import shutil
import signal
import subprocess
import sys
from pathlib import Path

import pytest
from command import Command
from refusal import QUIET, refused
from safetensors import safe_open
from safetensors.torch import save_file

from ringlight.cli import threads
from ringlight.cli.flags import behind_values
from ringlight.data.bundled import bundled_scene, scene_folder
from ringlight.errors import RecipeError

RINGLIGHT = [sys.executable, "-m", "ringlight"]
SHORT = ("--steps", "2", "--initial-points", "50", "--lpips")


def started(*words: object, script: str = '"$@"', **options: object) -> "subprocess.CompletedProcess[str]":
    """A process of its own, through a line of bash in which "$@" is the command."""
    line = ["bash", "-c", script, "bash", *RINGLIGHT, *map(str, words)]
    return subprocess.run(line, capture_output=True, text=True, timeout=120, check=False, **options)  # type: ignore[call-overload]


def test_an_export_looks_for_its_folder_first(
    run_folder: Path, tmp_path: Path, ringlight: Command, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("ringlight.runs.opened.open_model", lambda *_: pytest.fail("the model is read"))
    for verb, file in (("export", "x.ply"), ("compress", "x.safetensors")):
        refused(
            ringlight(verb, run_folder, tmp_path / "none" / file, "--quiet"), 1, "none", "its folder does not exist"
        )


def test_commands_to_copy_are_quoted(tiny: Path, tmp_path: Path, ringlight: Command) -> None:
    run = tmp_path / "my run; ü"
    done = ringlight("train", tiny, "3dgs", *SHORT, "--out", run)
    shown = done.err.rpartition("see it with: ")[2].strip()
    assert shlex.split(shown) == ["ringlight", "render", str(run)]
    again = ringlight("train", "--resume", run)
    assert shlex.split(again.err.strip().rpartition("with: ")[2]) == ["ringlight", "eval", str(run)]
    clash = refused(ringlight("train", tiny, "3dgs", "--out", run, *QUIET), 1, "already holds a run")
    assert shlex.split(clash.rpartition("go on with it: ")[2]) == ["ringlight", "train", "--resume", str(run)]
    (run / "model.safetensors").unlink()
    lacking = refused(ringlight("render", run, "--quiet"), 1, "holds no model yet")
    assert shlex.split(lacking.rpartition("with: ")[2]) == ["ringlight", "train", "--resume", str(run)]


def test_a_study_of_no_variant_is_no_study_of_all(tiny: Path, tmp_path: Path, ringlight: Command) -> None:
    words = ("study", "rank", tiny, "--out", tmp_path / "out", "--only")
    refused(ringlight(*words), 2, "--only names no variant")
    refused(ringlight(*words, "--quiet"), 2, "--only names no variant")
    wrong = refused(ringlight("study", "bogus", tiny), 2, "STUDY", "ablation")
    assert "'what'" not in wrong


def test_compressing_in_place_tells_the_size_before(
    trained: dict[str, Path], tmp_path: Path, ringlight: Command
) -> None:
    model = Path(shutil.copy(trained["3dgs"] / "model.safetensors", tmp_path / "model.safetensors"))
    before = model.stat().st_size
    told = json.loads(ringlight("compress", model, model, "--overwrite", "--json", "--quiet").out)
    assert (told["bytes_file_before"], told["bytes_file"]) == (before, model.stat().st_size)
    assert model.stat().st_size < before


# remedies


def test_remedies_fit_what_went_wrong(
    run_folder: Path, scene_copy: Path, tmp_path: Path, ringlight: Command, monkeypatch: pytest.MonkeyPatch
) -> None:
    refused(ringlight("render", run_folder, "--zoom", "inf"), 1, "--zoom is inf", "finite number")
    many = ("--initial-points", "1000000000000")
    assert "downscale" not in refused(ringlight("train", scene_copy, "3dgs", *many, *QUIET), 1, "--initial-points")
    record = json.loads((run_folder / "recipe.json").read_text())
    (run_folder / "recipe.json").write_text(json.dumps(record | {"scene": str(tmp_path / "gone")}))
    home = tmp_path / "file"
    home.write_text("no folder")
    monkeypatch.setenv("RINGLIGHT_CACHE", str(home / "cache"))
    refused(ringlight("fetch-lpips"), 1, home, "RINGLIGHT_CACHE")


def test_pictures_too_large_for_memory_do_not_name_flags_of_training(
    run_folder: Path, ringlight: Command, monkeypatch: pytest.MonkeyPatch
) -> None:
    def too_large(*_: object) -> None:
        raise MemoryError

    monkeypatch.setattr("ringlight.runs.film_pictures.render_film", too_large)
    sentence = refused(ringlight("render", run_folder, "--quiet"), 1, "not enough memory")
    assert "--densify" not in sentence
    assert "--width" in sentence


def test_a_checkpoint_of_another_run_is_called_so(
    trained: dict[str, Path], run_folder: Path, ringlight: Command
) -> None:
    shutil.copy(trained["3dgs"] / "checkpoint.safetensors", run_folder / "checkpoint.safetensors")
    refused(ringlight("train", "--resume", run_folder, "--quiet"), 1, "is of 3dgs with seed 0")


def test_a_strangers_model_of_huge_numbers_is_not_to_be_trained_otherwise(
    trained: dict[str, Path], tmp_path: Path, ringlight: Command
) -> None:
    with safe_open(trained["3dgs"] / "model.safetensors", framework="pt") as file:
        tensors = {name: file.get_tensor(name) for name in file.keys()}  # noqa: SIM118
        facts = file.metadata()
    tensors["columns.means"].fill_(3e38)
    facts.pop("checksum", None)
    model = tmp_path / "model.safetensors"
    save_file(tensors, model, metadata=facts)
    done = ringlight("render", model, "--path", "train", "--quiet", "--out", tmp_path / "out")
    assert "learn at lower rates" not in done.err
    assert done.code == 0 or str(model) in done.err


def test_errors_in_values_come_before_torch(tiny: Path) -> None:
    for words in (("--steps", "0"), ("--threads", "-1")):
        script = (
            f"import sys; from ringlight.cli.main import run; code = run({['train', str(tiny), '3dgs', *words]!r}); "
        )
        script += "sys.exit(code if 'torch' not in sys.modules else 99)"
        done = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True, timeout=60, check=False)
        assert done.returncode == 1, done.stderr
        assert done.stderr.startswith(f"ringlight: {words[0]} is {words[1]}; ")
    with pytest.raises(Exception, match="--threads is -1"):
        threads.check_threads(-1)


def test_a_full_disk_behind_standard_output_has_its_own_remedy(trained: dict[str, Path]) -> None:
    done = started("info", trained["3dgs"], script='"$@" > /dev/full')
    assert done.returncode == 1
    assert "--out" not in done.stderr
    assert "standard output" in done.stderr


@pytest.mark.skipif(sys.platform != "linux", reason="a folder in use cannot be deleted elsewhere")
def test_a_deleted_folder_is_named(tmp_path: Path) -> None:
    done = started("info", "run", script='mkdir gone; cd gone; rmdir ../gone; "$@"', cwd=tmp_path)
    assert done.returncode == 1
    assert done.stderr.startswith("ringlight: the folder that this shell stands in was deleted")


def test_a_library_that_cannot_be_loaded_is_one_sentence(
    run_folder: Path, ringlight: Command, monkeypatch: pytest.MonkeyPatch
) -> None:
    def cannot(*_: object) -> None:
        raise ImportError("libtorch_cpu.so: failed to map segment\nfrom shared object", name="torch._C")

    monkeypatch.setattr("ringlight.runs.facts.facts_of", cannot)
    refused(ringlight("info", run_folder), 1, "libtorch_cpu.so: failed to map segment from shared object", "memory")


# layers, flags, names


def test_a_layer_that_a_model_lacks_is_left_out(trained: dict[str, Path], tmp_path: Path, ringlight: Command) -> None:
    run = trained["3dgs"]
    done = ringlight("render", run, "--layers", "color", "modulation", "--quiet", "--out", tmp_path / "out")
    assert done.code == 0
    assert "warning: this model has no layer modulation; left out" in done.err
    assert [folder.name for folder in (tmp_path / "out").iterdir()] == ["color"]
    refused(ringlight("render", run, "--layers", "modulation", "--quiet"), 1, "modulation", "color")


def test_a_flag_of_several_values_leaves_the_scene(
    trained: dict[str, Path], tiny: Path, tmp_path: Path, ringlight: Command, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("RINGLIGHT_CACHE", str(tmp_path))
    done = ringlight("eval", trained["3dgs"] / "model.safetensors", "--quiet", "--json", "--lpips", "vgg", tiny)
    assert done.code == 0, done.err
    assert "LPIPS with vgg" in json.loads(done.out)["lpips_note"]
    line = ["run", "--quiet", "--layers", "color", "scene", "--fps", "3"]
    assert behind_values(line, "--layers", ("color", "base")) == ["run", "scene", "--quiet", *line[2:4], *line[5:]]
    assert behind_values(line, "--lpips", ("alex",)) == line


@pytest.mark.parametrize("word", ["colour", "color,base", "bases"])
def test_a_misspelt_value_is_told_from_a_folder(word: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    with pytest.raises(RecipeError, match=rf"^--layers is '{word}'; give some of color base"):
        behind_values(["run", "--layers", word], "--layers", ("color", "base"))
    (tmp_path / word).mkdir()
    assert behind_values(["--layers", word], "--layers", ("color", "base")) == [word, "--layers"]


def test_runs_named_as_their_method_are_named_once(
    trained: dict[str, Path], tmp_path: Path, ringlight: Command
) -> None:
    shutil.copytree(trained["3dgs"], tmp_path / "second")
    shown = ringlight("compare", trained["3dgs"], tmp_path / "second").out
    assert "3dgs 3dgs" not in shown
    assert "3dgs second" in shown


def test_bundled_scenes_are_known_by_name(tmp_path: Path, ringlight: Command, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    assert ringlight("train", "toaster", "3dgs", *SHORT, "--quiet", "--threads", "1").code == 0
    assert (tmp_path / "runs" / "toaster-3dgs" / "model.safetensors").is_file()
    assert scene_folder(Path("toaster")) == bundled_scene("toaster")
    Path("toaster").mkdir()
    assert scene_folder(Path("toaster")) == Path("toaster")


def test_the_help_says_what_readmes_use(capsys: pytest.CaptureFixture[str]) -> None:
    from ringlight.cli.main import run

    assert run(["train", "--help"]) == 0
    shown = " ".join(line.strip("│ ") for line in capsys.readouterr().out.splitlines())
    assert "--steps N" in shown
    assert "runs/SCENE-METHOD-2" in shown
    assert run(["train", "scene", "3dgs", "--help"]) == 0
    assert capsys.readouterr().out.startswith("usage: ringlight train SCENE 3dgs ")


def test_one_step_is_no_steps(tiny: Path, tmp_path: Path, ringlight: Command) -> None:
    words = ("--steps", "1", "--initial-points", "50", "--lpips", "--out", tmp_path / "run")
    done = ringlight("train", tiny, "3dgs", *words)
    assert "\n1 step, seed 0" in done.err
    assert done.code == 0
    told = ringlight("render", tmp_path / "run", "--frames", "1", "--out", tmp_path / "out")
    assert "1 frame of" in told.err


def test_words_of_the_first_lines_are_those_of_photographers(tiny: Path, tmp_path: Path, ringlight: Command) -> None:
    done = ringlight("train", tiny, "3dgs", *SHORT, "--out", tmp_path / "run")
    assert "white background" in done.err
    said = done.out + done.err
    for explained in ("PSNR and SSIM: likeness to photographs", "raw MB: what showing", "core s: processor"):
        assert explained in said
    for of_the_trade in ("deferred", "forward", "harmonics", "hull", "background photograph", "lit per pixel"):
        assert of_the_trade not in said


def test_words_that_a_beginner_tries(tmp_path: Path, ringlight: Command, capsys: pytest.CaptureFixture[str]) -> None:
    told = ringlight("help", "eval")
    assert told.code == 0
    assert told.out == ringlight("eval", "--help").out
    refused(ringlight("report"), 2, "missing: RUN, FILE.html")
    refused(ringlight("study", "rank", "toaster", "--seeds", "0,1"), 2, "--seeds is how many there are")


def test_settings_in_the_help_are_flags(ringlight: Command) -> None:
    shown = " ".join(line.strip("│ ") for line in ringlight("train", "x", "ringlight-basis", "--help").out.splitlines())
    assert "By default four times --basis-rate." in shown
    assert "`" not in shown


def test_who_stops_before_the_first_step_hears_that_nothing_is_lost(
    tiny: Path, tmp_path: Path, ringlight: Command, monkeypatch: pytest.MonkeyPatch
) -> None:
    def pressed(*_: object, **__: object) -> None:
        raise KeyboardInterrupt

    monkeypatch.setattr("ringlight.runs.start.prepare_run", pressed)
    done = ringlight("train", tiny, "3dgs", "--out", tmp_path / "out", *SHORT)
    assert done.code == 130
    assert "interrupted before the first step; the same command begins again" in done.err
    assert not (tmp_path / "out").exists()


SIGNALLED_AT = """
import signal, sys
from importlib import import_module
from ringlight.cli.main import main
number, module, name = int(sys.argv[1]), import_module(sys.argv[2]), sys.argv[3]
signal.signal(number, signal.SIG_DFL)  # nohup, which tests may run under, has it ignored
def signalled(*_, **__):
    try:
        signal.raise_signal(number)
    finally:  # who closes a terminal sends several
        signal.raise_signal(signal.SIGTERM)
        signal.raise_signal(signal.SIGHUP)
setattr(module, name, signalled)
main(sys.argv[4:])
"""
"""Runs a command to which signals come where a function of a module is called."""


def signalled(number: signal.Signals, at: str, *words: object) -> "subprocess.CompletedProcess[str]":
    line = [sys.executable, "-c", SIGNALLED_AT, str(int(number)), *at.split(":"), *map(str, words)]
    return subprocess.run(line, capture_output=True, text=True, timeout=120, check=False)


@pytest.mark.skipif(sys.platform == "win32", reason="signals are other there")
@pytest.mark.parametrize("number", [signal.SIGTERM, signal.SIGHUP])
def test_any_signal_before_the_first_step_is_answered(number: signal.Signals, tiny: Path, tmp_path: Path) -> None:
    words = ("train", tiny, "3dgs", "--out", tmp_path / "out", *SHORT)
    done = signalled(number, "ringlight.runs.start:prepare_run", *words)
    assert done.returncode == 128 + number
    assert done.stderr.endswith("interrupted before the first step; the same command begins again\n")
    assert not (tmp_path / "out").exists()


@pytest.mark.skipif(sys.platform == "win32", reason="signals are other there")
@pytest.mark.parametrize("at", ["ringlight.cli.main:_show_beginning", "ringlight.cli.doctor:main"])
def test_signals_end_any_command_at_any_time_in_a_sentence(at: str) -> None:
    done = signalled(signal.SIGHUP, at, "doctor")
    assert (done.returncode, done.stderr) == (128 + signal.SIGHUP, "ringlight: interrupted\n")
