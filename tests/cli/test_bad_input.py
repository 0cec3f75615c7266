"""A user's mistake: one sentence that names the place and the remedy, the right exit code, nothing overwritten.

Damaged scenes are in test_bad_scenes.py; damage at every byte of PLY and model files is tested beside their readers.
"""

import errno
import json
import os
import shutil
import struct
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import pytest
import torch
from command import Command, Outcome
from refusal import QUIET, SHORT, Damage, refused, snapshot
from scenes_on_disk import edit_json

import ringlight as ringlight_package
from ringlight import _kernels
from ringlight.files.tensor_file import read_tensors, write_tensors


def test_missing_and_empty_folders(tmp_path: Path, ringlight: Command) -> None:
    out = tmp_path / "out"
    (tmp_path / "empty").mkdir()
    for place in ("missing", "empty"):
        refused(ringlight("train", tmp_path / place, "3dgs", "--out", out, *QUIET), 1, tmp_path / place)
    for verb in (["eval"], ["render"], ["info"], ["export"]):
        last = [tmp_path / "x.ply"] if verb == ["export"] else []
        for place in ("missing", "empty"):
            refused(ringlight(*verb, tmp_path / place, *last), 1, tmp_path / place)
    assert [path.name for path in tmp_path.iterdir()] == ["empty"]


@pytest.mark.parametrize(
    "flag",
    [
        ("--steps", "0"),
        ("--steps", "10000001"),
        ("--steps", "1" + 20 * "0"),
        ("--seed", "-1"),
        ("--threads", "-1"),
        ("--threads", "1025"),
        ("--threads", "99999999999"),
        ("--seed", str(2**63)),
        ("--sh-degree", "4"),
        ("--densify.every", "0"),
        ("--rates.means", "-1"),
        ("--rates.scales", "nan"),
        ("--sh-rate", "inf"),
        ("--loss.ssim-weight", "3"),
        ("--loss.scale", "0"),
        ("--densify.stop", "7"),
        ("--densify.stop", "nan"),
        ("--densify.threshold", "-1"),
        ("--densify.threshold", "inf"),
        ("--densify.clone-below", "inf"),
        ("--densify.prune-scale", "inf"),
        ("--eval-at", "30001"),
        ("--save-every", "nan"),
    ],
)
def test_settings_beyond_their_range(flag: tuple[str, str], tiny: Path, tmp_path: Path, ringlight: Command) -> None:
    words = ("train", tiny, "3dgs", "--out", tmp_path / "out", *flag, "--quiet")
    sentence = refused(ringlight(*words), 1)
    assert sentence.startswith(f"ringlight: {flag[0]} is "), "the flag is named as it was given"
    assert not (tmp_path / "out").exists()


@pytest.mark.parametrize(
    "flag",
    [("--warmup", "2"), ("--base-rate", "nan"), ("--light.ring.rank", "0"), ("--light.ring.core_scale", "inf")],
)
def test_settings_of_the_light_beyond_their_range(
    flag: tuple[str, str], tiny: Path, tmp_path: Path, ringlight: Command
) -> None:
    words = ("train", tiny, "ringlight-ring", "--out", tmp_path / "out", *flag, "--quiet")
    refused(ringlight(*words), 1, flag[0].replace("_", "-"))
    assert not (tmp_path / "out").exists()


def test_a_resumed_run_keeps_its_recipe(trained: dict[str, Path], ringlight: Command) -> None:
    before = snapshot(trained["3dgs"])
    refused(ringlight("train", "--resume", trained["3dgs"], "--seed", "7"), 2, "keeps its recipe", "--seed")
    refused(ringlight("train", "--resume", trained["3dgs"], "--densify.every=3"), 2, "--densify.every")
    besides = ringlight("train", "photos", "3dgs", "--resume", trained["3dgs"])
    refused(besides, 2, "in place of SCENE and METHOD", "ringlight train --resume RUN")
    assert snapshot(trained["3dgs"]) == before


def test_folders_above_and_below_a_scene(tiny: Path, tmp_path: Path, ringlight: Command) -> None:
    root = tmp_path / "data"
    shutil.copytree(tiny, root / "balls")
    out = ("--out", tmp_path / "out", *QUIET)
    refused(ringlight("train", root, "3dgs", *out), 1, root / "balls")
    below = next(path for path in (root / "balls").iterdir() if path.is_dir())
    assert refused(ringlight("train", below, "3dgs", *out), 1).endswith(str(root / "balls"))


def test_a_folder_of_runs_names_them(trained: dict[str, Path], ringlight: Command) -> None:
    for verb in ("eval", "render", "info", "compare"):
        refused(ringlight(verb, trained["3dgs"].parent), 1, trained["3dgs"], trained["ringlight-ring"])


def test_a_forgotten_method_is_not_mistaken_for_a_flags_value(tiny: Path, ringlight: Command) -> None:
    sentence = refused(ringlight("train", "--seed", "5", tiny), 2, "3dgs")
    assert "called '5'" not in sentence


def test_a_scene_that_has_lost_photographs_is_not_gone_on_with(
    scene_copy: Path, tmp_path: Path, ringlight: Command
) -> None:
    run = tmp_path / "run"
    assert ringlight("train", scene_copy, "3dgs", "--out", run, *SHORT).code == 0
    edit_json(scene_copy / "transforms_train.json", lambda document: document["frames"].pop())
    before = snapshot(run)
    refused(ringlight("train", "--resume", run, *QUIET), 1, scene_copy, run, "5 training views", "began with 6")
    assert snapshot(run) == before


def test_memory_that_torch_cannot_have_is_a_sentence(ringlight: Command, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("ringlight.cli.info.main", lambda arguments: torch.empty(1 << 50))
    refused(ringlight("info", "model"), 1, "not enough memory")


def test_a_folder_of_photographs_is_no_run(tiny: Path, tmp_path: Path, ringlight: Command) -> None:
    refused(ringlight("info", tiny), 1, tiny, "model.safetensors")
    refused(ringlight("train", "--resume", tiny), 1, tiny)
    refused(ringlight("train", "--resume", tmp_path / "missing"), 1, tmp_path / "missing")


def test_a_gaussian_ply_is_no_model_file(trained: dict[str, Path], tmp_path: Path, ringlight: Command) -> None:
    exported = tmp_path / "balls.ply"
    assert ringlight("export", trained["3dgs"], exported).code == 0
    refused(ringlight("info", exported), 1, exported)


def _with_header(file: Path, change: Callable[[dict], object]) -> None:
    """Rewrite the JSON header of a safetensors file, as a program would that knows nothing of our checksum."""
    content = file.read_bytes()
    (length,) = struct.unpack("<Q", content[:8])
    header = json.loads(content[8 : 8 + length])
    change(header)
    header["__metadata__"].pop("ringlight.checksum", None)
    encoded = json.dumps(header).encode()
    file.write_bytes(struct.pack("<Q", len(encoded)) + encoded + content[8 + length :])


def _cut(share: float) -> Damage:
    def damage(file: Path) -> None:
        content = file.read_bytes()
        file.write_bytes(content[: int(share * len(content))])

    return damage


def _absurd_count(header: dict) -> None:
    header["columns.means"]["shape"][0] = 2**50


DAMAGED_MODELS: dict[str, tuple[Damage, str]] = {
    "empty": (_cut(0), "empty"),
    "cut in its header": (_cut(0.01), "cut"),
    "cut in its middle": (_cut(0.5), "cut"),
    "cut by a little": (_cut(0.999), "cut"),
    "an absurd count": (lambda file: _with_header(file, _absurd_count), "columns.means"),
    "a newer format": (
        lambda file: _with_header(file, lambda header: header["__metadata__"].update(format="99")), "pip install"
    ),
    "an unknown method": (
        lambda file: _with_header(file, lambda header: header["__metadata__"].update(method="Nonsense")), "Nonsense"
    ),
    "a missing tensor": (
        lambda file: _with_header(file, lambda header: header.update({"odd": header.pop("columns.means")})), "means"
    ),
    "something else": (lambda file: file.write_bytes(b"plain text, and a good deal of it"), "safetensors"),
}  # fmt: skip


@pytest.mark.parametrize("name", DAMAGED_MODELS)
def test_a_damaged_model_is_refused(name: str, run_folder: Path, tmp_path: Path, ringlight: Command) -> None:
    damage, hint = DAMAGED_MODELS[name]
    model = run_folder / "model.safetensors"
    damage(model)
    before = snapshot(run_folder)
    for words in (
        ["render", run_folder, "--path", "orbit"],
        ["eval", run_folder],
        ["export", model, tmp_path / "a.ply"],
    ):
        refused(ringlight(*words), 1, model, hint)
    if name not in ("an unknown method", "a missing tensor"):
        refused(ringlight("info", run_folder), 1, model, hint)
    assert snapshot(run_folder) == before
    assert not (tmp_path / "a.ply").exists()


def test_wrong_usage_ends_with_two(tiny: Path, tmp_path: Path, ringlight: Command) -> None:
    out = ("--out", tmp_path / "out")
    refused(ringlight("trian"), 2, "trian", "ringlight train")
    refused(ringlight("train", tiny, "3dsg", *out), 2, "3dsg", "3dgs")
    refused(ringlight("train", tiny, "nonsense", *out), 2, "nonsense", "ringlight-paper")
    refused(ringlight("train", tiny, "ringligt", "--steps", "3", *out), 2, "'ringligt'; perhaps you meant 'ringlight'")
    refused(ringlight("train", "toster", "3dgs", *out), 1, "toster: no such folder; perhaps you meant", "'toaster'")
    refused(ringlight("train", tiny, "3dgs", "--stesp", "3", *out), 2, "--stesp", "perhaps you meant --steps")
    refused(ringlight("train", "--step", "3", tiny, "3dgs", *out), 2, "--step;", "perhaps you meant --steps")
    refused(ringlight("train", tiny, "--steps", "3", "3dgs", *out), 2, "--steps is a method's and goes behind its name")
    remedy = (
        f"a method is missing behind {tiny}; 'ringlight' chooses one for the scene: ringlight train {tiny} ringlight"
    )
    refused(ringlight("train", tiny, "--steps", "3", *out), 2, f"{remedy} --steps 3 --out")
    refused(ringlight("train", tiny, "--steps", "3", "3dgs"), 2, "--steps is a method's and goes behind its name")
    refused(ringlight("train", tiny, "ringlight", "--rank", "3", *out), 2, "perhaps you meant --light.ring.rank")
    refused(ringlight("train", tiny, "putt", "--rank", "3", *out), 2, "meant --appearance-rank", "SCENE putt --help")
    refused(ringlight("train", tiny, "3dgs", "--steps", "many", *out), 2, "--steps", "is not a whole number")
    refused(ringlight("train", tiny, "3dgs", "--steps", "many", "--out", "ringlight"), 2, "SCENE 3dgs --help")
    refused(ringlight("train", "--resume", "3dgs", "--stesp", "3"), 2, "meant --steps", "see 'ringlight train --help'")
    refused(ringlight("train", tiny, "3dgs", "--warmup", "0.1", *out), 2, "--warmup", "ringlight-ring")
    refused(ringlight("train", tiny, "ringlight", "--light.mask", *out), 2, "--light.mask", "-ring or ringlight-paper;")
    refused(ringlight("train", tiny, "ringlight", "--base-rate=1", *out), 2, "--base-rate", "ringlight-mirror")
    refused(ringlight("train", tiny, "--seed", "3", "nonsense", *out), 2, "nonsense", "3dgs")
    refused(ringlight("train", tiny, *out), 2, f"{remedy} --out")
    refused(ringlight("train", tiny, "--steps", "10"), 2)
    refused(ringlight("train"), 2, "SCENE")
    refused(ringlight("export"), 2, "MODEL, OUT.ply")
    for verb in ("eval", "render", "info", "export"):
        refused(ringlight(verb), 2, f"ringlight {verb} --help")
        refused(ringlight(verb, "--nonsense"), 2, f"ringlight {verb} --help")
    refused(ringlight("render", tmp_path, "--layers", "nonsense"), 2, "nonsense")
    refused(ringlight("train", tiny, "3dgs", "--device", "tpu", *out), 2, "--device", "reference")
    refused(ringlight("doctor", "everything"), 2, "everything")
    assert not (tmp_path / "out").exists()


def test_values_out_of_range(tiny: Path, trained: dict[str, Path], tmp_path: Path, ringlight: Command) -> None:
    run = trained["3dgs"]
    refused(ringlight("render", run, "--frames", "0"), 1, "--frames")
    refused(ringlight("render", run, "--path", "orbit", "--frames", "1000000000"), 1, "--frames", "108000")
    refused(ringlight("render", run, "--scale", "-1"), 1, "--scale")
    refused(ringlight("render", run, "--zoom", "0"), 1, "--zoom")
    refused(ringlight("render", run, "--path", "orbit", "--width", "100000000"), 1, "--width")
    refused(ringlight("render", run, "--width", "10", "--scale", "2"), 1, "--width", "--scale")
    refused(ringlight("train", tiny, "3dgs", "--downscale", "0", "--out", tmp_path / "out"), 1, "--downscale")
    assert not (run / "renders").exists()


def test_a_layer_that_the_model_lacks(trained: dict[str, Path], ringlight: Command) -> None:
    before = snapshot(trained["3dgs"])
    sentence = refused(ringlight("render", trained["3dgs"], "--layers", "modulation"), 1, "modulation")
    assert "residual" in sentence
    assert snapshot(trained["3dgs"]) == before


def test_output_folders_that_hold_something(tiny: Path, run_folder: Path, tmp_path: Path, ringlight: Command) -> None:
    other = tmp_path / "notes"
    other.mkdir()
    (other / "notes.txt").write_text("mine")
    before = snapshot(run_folder, other)
    refused(ringlight("train", tiny, "3dgs", "--out", run_folder, *SHORT), 1, run_folder, "--resume")
    refused(ringlight("train", tiny, "3dgs", "--out", other, *SHORT), 1, other, "--out")
    refused(ringlight("train", tiny, "3dgs", "--out", other / "notes.txt", *SHORT), 1, "notes.txt")
    refused(ringlight("eval", run_folder, "--out", other, *QUIET), 1, other)
    refused(ringlight("eval", run_folder, "--images", other, *QUIET), 1, other)
    refused(ringlight("render", run_folder, "--out", other, "--path", "orbit"), 1, other)
    refused(ringlight("export", run_folder, other / "notes.txt"), 1, "notes.txt", ".ply")
    (other / "old.ply").write_text("mine")
    refused(ringlight("export", run_folder, other / "old.ply"), 1, "old.ply", "--overwrite")
    assert (other / "old.ply").read_text() == "mine"
    (other / "old.ply").unlink()
    assert snapshot(run_folder, other) == before


def test_damaged_files_of_a_run(run_folder: Path, ringlight: Command) -> None:
    for name, words in {
        "recipe.json": ["train", "--resume", run_folder],
        "checkpoint.safetensors": ["train", "--resume", run_folder],
    }.items():
        original = (run_folder / name).read_bytes()
        for content in (b"", original[: len(original) // 2], b"{}", b'{"preset": 3}', b"[" * 100_000):
            (run_folder / name).write_bytes(content)
            before = snapshot(run_folder)
            refused(ringlight(*words), 1, run_folder / name)
            assert snapshot(run_folder) == before
        (run_folder / name).write_bytes(original)


def test_a_checkpoint_of_another_recipe(run_folder: Path, ringlight: Command) -> None:
    edit_json(run_folder / "recipe.json", lambda record: record["recipe"]["light"]["ring"].update(rank=5))
    refused(ringlight("train", "--resume", run_folder), 1, run_folder / "checkpoint.safetensors")


@pytest.mark.parametrize("value", ["many", None, [1], {"a": 1}, True])
def test_settings_of_another_type(value: object, run_folder: Path, ringlight: Command) -> None:
    edit_json(run_folder / "recipe.json", lambda record: record["recipe"].update(steps=value))
    refused(ringlight("train", "--resume", run_folder), 1, run_folder / "recipe.json", "steps")
    edit_json(run_folder / "recipe.json", lambda record: record.update(method="nerf"))
    refused(ringlight("train", "--resume", run_folder), 1, run_folder / "recipe.json", "method 'nerf' is unknown")
    edit_json(run_folder / "recipe.json", lambda record: record.update(recipe=value))
    refused(ringlight("train", "--resume", run_folder), 1, run_folder / "recipe.json")
    edit_json(run_folder / "recipe.json", lambda record: record.update(options=value))
    refused(ringlight("train", "--resume", run_folder), 1, run_folder / "recipe.json")


@pytest.mark.parametrize("value", ["7", None, True, -1, 0.5, float("inf"), 2**63])
def test_a_seed_that_is_none(value: object, run_folder: Path, ringlight: Command) -> None:
    edit_json(run_folder / "recipe.json", lambda record: record.update(seed=value))
    refused(ringlight("train", "--resume", run_folder), 1, run_folder / "recipe.json", "seed")


def test_a_setting_that_was_infinite_in_an_earlier_version(run_folder: Path, ringlight: Command) -> None:
    edit_json(run_folder / "recipe.json", lambda record: record["recipe"]["densify"].update(threshold=float("inf")))
    assert "Infinity" in (run_folder / "recipe.json").read_text()
    assert ringlight("train", "--resume", run_folder, "--steps", 2, *QUIET).code == 0
    assert "Infinity" not in (run_folder / "recipe.json").read_text(), "with the added steps it is valid JSON"


@pytest.mark.parametrize("value", [10**400, -(2**63)])
def test_a_number_that_no_setting_takes(value: int, run_folder: Path, ringlight: Command) -> None:
    edit_json(run_folder / "recipe.json", lambda record: record["options"].update(photo_memory=value))
    refused(ringlight("train", "--resume", run_folder), 1, run_folder / "recipe.json", "photo_memory cannot be")


def test_a_model_in_place_of_the_checkpoint(run_folder: Path, ringlight: Command) -> None:
    shutil.copy(run_folder / "model.safetensors", run_folder / "checkpoint.safetensors")
    refused(ringlight("train", "--resume", run_folder), 1, run_folder / "checkpoint.safetensors")


def test_a_run_without_a_checkpoint(run_folder: Path, ringlight: Command) -> None:
    (run_folder / "checkpoint.safetensors").unlink()
    refused(ringlight("train", "--resume", run_folder), 1, run_folder)


def test_a_scene_that_has_moved(run_folder: Path, tmp_path: Path, ringlight: Command) -> None:
    edit_json(run_folder / "recipe.json", lambda record: record.update(scene=str(tmp_path / "gone")))
    refused(ringlight("train", "--resume", run_folder), 1, tmp_path / "gone")


def test_a_scene_that_has_moved_may_be_named_by_every_command_that_takes_it(
    run_folder: Path, scene_copy: Path, tmp_path: Path, ringlight: Command
) -> None:
    run = Path(shutil.copytree(run_folder, tmp_path / "my run"))
    edit_json(run / "recipe.json", lambda record: record.update(scene=str(tmp_path / "gone")))
    out, quiet = tmp_path / "small.safetensors", ("--quiet", "--lpips")
    ways = {
        "eval": (f"ringlight eval '{run}' FOLDER", ("eval", run, scene_copy, *quiet)),
        "render": (f"ringlight render '{run}' --scene FOLDER", ("render", run, "--scene", scene_copy, "--quiet")),
        "compress": (f"ringlight compress '{run}' {out} FOLDER", ("compress", run, out, scene_copy, "--overwrite")),
    }
    for verb, (way, words) in ways.items():
        said = ringlight(verb, run, *(out,) * (verb == "compress")).err
        for part in (tmp_path / "gone", f'put it back, correct "scene" in {run / "recipe.json"}, or', way):
            assert str(part) in said, verb
        assert ringlight(*words).code == 0, "the remedy works"
    refused(ringlight("render", run), 1, "--path orbit needs no photographs")
    assert ringlight("render", run, "--path", "orbit", "--frames", "1", "--quiet").code == 0
    assert "recipe.json" not in refused(ringlight("eval", out), 1, f"ringlight eval {out} FOLDER")


def test_photographs_of_another_scene_are_told_and_measured(
    run_folder: Path, tiny: Path, tmp_path: Path, ringlight: Command
) -> None:
    other = Path(shutil.copytree(tiny, tmp_path / "others"))
    for scene, told in ((tiny, False), (other, True)):
        done = ringlight("eval", run_folder, scene, "--quiet", "--lpips")
        assert done.code == 0, done.err
        assert (f"the model learned {tiny.name}, these photographs are of others" in done.err) == told


@pytest.mark.parametrize("options", [3, "colmap", [], {"format": "colour"}, {"zoom": 2}, {"downscale": 0}])
def test_a_model_file_with_damaged_options(options: object, run_folder: Path, ringlight: Command) -> None:
    model = run_folder / "model.safetensors"
    file = read_tensors(model)
    scene = json.loads(file.metadata["scene"]) | {"options": options}
    write_tensors(model, file.tensors, file.metadata | {"scene": json.dumps(scene)})
    refused(ringlight("eval", model), 1, model)
    refused(ringlight("render", model), 1, model)
    told = ringlight("compress", model, run_folder / "packed.safetensors")
    if isinstance(options, dict):  # compressing asks for no photographs
        assert told.code == 0
        assert "not measured on photographs" in told.err
    else:
        refused(told, 1, model)


def test_a_damaged_report_is_made_again_by_eval(run_folder: Path, ringlight: Command) -> None:
    (run_folder / "report.json").write_text("{")
    told = ringlight("info", run_folder)
    assert told.code == 0
    assert "report.json" in told.out
    assert ringlight("eval", run_folder, *QUIET).code == 0
    assert json.loads((run_folder / "report.json").read_text())["train_seconds"] > 0


def test_kernels_that_cannot_run(
    tiny: Path, trained: dict[str, Path], tmp_path: Path, ringlight: Command, monkeypatch: pytest.MonkeyPatch
) -> None:
    def refuse() -> str:
        raise RuntimeError("this processor lacks AVX2; use another machine")

    monkeypatch.setattr(_kernels, "isa", refuse)
    refused(ringlight("train", tiny, "3dgs", "--out", tmp_path / "out", *SHORT), 1, "AVX2")
    for verb in ("eval", "render"):
        refused(ringlight(verb, trained["3dgs"]), 1, "AVX2")
    refused(ringlight("export", trained["3dgs"], tmp_path / "a.ply"), 1, "AVX2")
    assert ringlight("info", trained["3dgs"]).code == 0
    assert not (tmp_path / "out").exists()


FULL_DISK = """
import resource, signal, sys
sys.dont_write_bytecode = True  # Python would leave compiled modules cut off at the limit, for every later process
signal.signal(signal.SIGXFSZ, signal.SIG_IGN)
resource.setrlimit(resource.RLIMIT_FSIZE, ({limit}, {limit}))
sys.path.insert(0, {source!r})
from ringlight.cli.main import main
main({words!r})
"""


@pytest.mark.skipif(sys.platform == "win32", reason="Windows knows no limit on the size of files")
@pytest.mark.parametrize("verb", ["train", "eval", "render", "export"])
def test_a_disk_that_is_full(verb: str, tiny: Path, run_folder: Path, tmp_path: Path) -> None:
    """The system refuses to write beyond a few hundred bytes, as a full disk does."""
    words = {
        "train": ["train", tiny, "3dgs", "--out", tmp_path / "out", *SHORT],
        "eval": ["eval", run_folder, *QUIET],
        "render": ["render", run_folder, "--path", "orbit", "--quiet"],
        "export": ["export", run_folder, tmp_path / "a.ply"],
    }[verb]
    before = snapshot(run_folder)
    source = str(Path(ringlight_package.__file__ or "").parents[1])
    script = FULL_DISK.format(limit=200, source=source, words=[str(word) for word in words])
    done = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True, timeout=120, check=False)
    assert ("PSNR" in done.stdout) == (verb == "eval"), "numbers are shown before they are written"
    refused(Outcome(done.returncode, "", done.stderr), 1, "file")
    assert {name: digest for name, digest in snapshot(run_folder).items() if name in before} == before
    assert not (tmp_path / "a.ply").exists()
    assert not list(tmp_path.rglob("*.part"))


def test_no_space_left(tiny: Path, tmp_path: Path, ringlight: Command, monkeypatch: pytest.MonkeyPatch) -> None:
    def full(handle: int) -> None:
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

    monkeypatch.setattr(os, "fsync", full)
    refused(ringlight("train", tiny, "3dgs", "--out", tmp_path / "out", *SHORT), 1, tmp_path / "out", "space")
    assert not list((tmp_path / "out").iterdir())
