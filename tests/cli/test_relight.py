"""Relighting: a run that freezes all but light, a small pack of it, and sentences for what does not fit."""

import json
import shutil
import signal
from collections.abc import Callable
from pathlib import Path

import pytest
import torch
from cli_session import QUICK
from command import Command
from refusal import refused, snapshot
from scenes_on_disk import edit_json, write_tiny_scene

from relit_scenes import evening_scene
from ringlight.core.want import Want
from ringlight.errors import RunError
from ringlight.files.tensor_file import read_tensors, write_tensors
from ringlight.methods.store import load_model
from ringlight.rasterize.choose import host_rasterizer
from ringlight.runs.light_pack import pack_between
from ringlight.runs.session import Session

STEPS = ("--steps", "12", "--quiet", "--lpips")


@pytest.fixture(scope="module")
def evening(tiny: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    return evening_scene(tiny, tmp_path_factory.mktemp("evening") / "evening")


@pytest.fixture(scope="module")
def mirrors(tiny: Path, tmp_path_factory: pytest.TempPathFactory) -> dict[str, Path]:
    """Whose opacities change with the view, and whose are constant."""
    from ringlight.cli.main import run

    folders = {}
    for name, flags in (("ringlight-mirror", ()), ("mirror of constant opacities", ("--no-varying-opacity",))):
        folders[name] = tmp_path_factory.mktemp("mirror") / "mirror"
        # Lit after step 4 of 40, as when it was measured what they learn.
        words = ["train", str(tiny), "ringlight-mirror", *flags, "--warmup", "0.1", "--out", str(folders[name])]
        assert run([*words, "--steps", "40", "--quiet", "--lpips"]) == 0
    return folders


def pressed(session: Session) -> None:
    signal.raise_signal(signal.SIGINT)


@pytest.mark.parametrize(
    ("method", "on_seen", "on_held_out"),
    # A mirror learns most, and of photographs as few and small as these by heart: held-out views may lose by it, where
    # opacities were learned in another light (0.2 to 0.7 dB over three seeds), with constant ones 0.2 dB on a processor
    # with AVX-512. Of 45 photographs they gain 8 dB (docs/edit.md).
    [
        ("ringlight-basis", 0.1, 0.1),
        ("ringlight-ring", 0.1, 0.1),
        ("mirror of constant opacities", 1.0, -0.3),
        ("ringlight-mirror", 1.0, -1.5),
    ],
)
def test_light_is_learned_and_all_else_stays(
    method: str,
    on_seen: float,
    on_held_out: float,
    trained: dict[str, Path],
    mirrors: dict[str, Path],
    evening: Path,
    tmp_path: Path,
    ringlight: Command,
) -> None:
    run, out, relit = (trained | mirrors)[method], tmp_path / "out", tmp_path / "relit.safetensors"
    done = ringlight("relight", run, evening, out, *STEPS, "--json")
    assert done.code == 0, done.err
    told = json.loads(done.out)
    assert told["pack"]["bytes_file"] == (out / "light.safetensors").stat().st_size
    assert told["pack"]["picture_psnr"] > 40
    own = json.loads(ringlight("eval", run, evening, "--json", "--lpips", "--quiet").out)
    assert told["report"]["psnr"] > own["psnr"] + on_held_out
    assert told["report"]["psnr_train"] > own["psnr_train"] + on_seen

    before, after = (read_tensors(folder / "model.safetensors").tensors for folder in (run, out))
    for name in before:
        if name.startswith("columns.") and name != "columns.sh_dc":
            assert torch.equal(before[name], after[name]), name
    pack = read_tensors(out / "light.safetensors").tensors
    assert not [name for name in pack if name.startswith("columns.")]

    assert ringlight("edit", run, relit, "--light", out, "--quiet").code == 0
    model, learned = (load_model(path, host_rasterizer()) for path in (relit, out))
    camera = learned.cameras[0]
    pictures = [one.model.render(camera, torch.ones(3), Want.EXACT).color for one in (model, learned)]
    assert float(((pictures[0] - pictures[1]) ** 2).mean()) < 1e-4


@pytest.mark.parametrize(("during", "said"), [("read_start", "the same command begins"), ("session", "go on with:")])
def test_who_stops_before_the_first_step_hears_what_goes_on(
    during: str, said: str, trained: dict[str, Path], evening: Path, tmp_path: Path, ringlight: Command, monkeypatch
) -> None:
    def interrupt(*_: object, **__: object) -> None:
        raise KeyboardInterrupt

    if during == "read_start":
        monkeypatch.setattr("ringlight.runs.start.read_start", interrupt)
    else:
        save = Session.save
        monkeypatch.setattr(Session, "save", lambda session: (save(session), interrupt()))
    done = ringlight("relight", trained["ringlight-ring"], evening, tmp_path / "out", *STEPS)
    assert done.code == 128 + signal.SIGINT
    assert f"interrupted before the first step; {said}" in done.err


def test_a_stopped_run_goes_on_to_the_same_pack_on_any_threads(
    trained: dict[str, Path],
    evening: Path,
    tmp_path: Path,
    ringlight: Command,
    at_step: Callable[[int, Callable[[Session], object]], None],
) -> None:
    run = trained["ringlight-ring"]
    assert ringlight("relight", run, evening, tmp_path / "whole", *STEPS, "--threads", "1").code == 0
    at_step(5, pressed)
    stopped = ringlight("relight", run, evening, tmp_path / "stopped", *STEPS, "--threads", "2")
    assert stopped.code == 128 + signal.SIGINT
    assert f"ringlight relight --resume {tmp_path / 'stopped'}" in stopped.err
    assert not (tmp_path / "stopped" / "light.safetensors").exists()
    at_step(-1, pressed)
    assert (
        f"go on with: ringlight relight --resume {tmp_path / 'stopped'}" in ringlight("info", tmp_path / "stopped").out
    )
    words = ("relight", run, evening, tmp_path / "stopped", *STEPS)
    refused(ringlight(*words), 1, "give another OUT", f"ringlight relight --resume {tmp_path / 'stopped'}")
    refused(
        ringlight("train", "--resume", tmp_path / "stopped", "--quiet"),
        1,
        f"learns a light, of which a pack is made; go on with: ringlight relight --resume {tmp_path / 'stopped'}",
    )
    assert ringlight("relight", "--resume", tmp_path / "stopped", "--quiet", "--lpips").code == 0
    packs = [(tmp_path / name / "light.safetensors").read_bytes() for name in ("whole", "stopped")]
    assert packs[0] == packs[1]
    (tmp_path / "stopped" / "light.safetensors").unlink()
    again = ringlight("relight", "--resume", tmp_path / "stopped", "--eval-at", "5", "--quiet")
    assert (again.code, again.err) == (0, "warning: --eval-at 5 has no effect: no step is left to do\n")
    assert (tmp_path / "stopped" / "light.safetensors").read_bytes() == packs[0]


def test_what_does_not_fit_is_refused_and_nothing_is_written(
    trained: dict[str, Path], evening: Path, tmp_path: Path, ringlight: Command
) -> None:
    run, out = trained["ringlight-basis"], tmp_path / "out"
    (tmp_path / "scenes").mkdir()
    larger = write_tiny_scene(tmp_path / "scenes" / "larger", size=24)
    apart = Path(shutil.copytree(evening, tmp_path / "scenes" / "apart"))
    edit_json(apart / "transforms_train.json", _moved)
    before = snapshot(tmp_path)
    refused(ringlight("relight", trained["3dgs"], evening, out, *STEPS), 1, "light of 3dgs does not lie in", "train")
    refused(ringlight("relight", run, larger, out, *STEPS), 1, "24 x 24", "20 x 20")
    refused(ringlight("relight", run, apart, out, *STEPS), 1, apart, "same world")
    refused(ringlight("relight", run, tmp_path / "nothing", out, *STEPS), 1, "nothing")
    refused(ringlight("relight", run, evening, out, "--steps", "0"), 1, "--steps")
    refused(ringlight("relight", "--resume", run), 1, "does not relight")
    assert snapshot(tmp_path) == before
    out.mkdir()
    (out / "mine").write_text("mine")
    refused(ringlight("relight", run, evening, out, *STEPS), 1, out, "not an empty folder")


def _moved(document) -> None:  # type: ignore[no-untyped-def]
    for frame in document["frames"]:
        frame["transform_matrix"][2][3] += 0.5


def test_a_pack_fits_one_model_alone(
    trained: dict[str, Path], evening: Path, tiny: Path, tmp_path: Path, ringlight: Command
) -> None:
    run, out, other = trained["ringlight-basis"], tmp_path / "out", tmp_path / "other"
    assert ringlight("relight", run, evening, out, *STEPS).code == 0
    assert ringlight("train", tiny, "ringlight-basis", "--out", other, *QUICK, "--seed", "1").code == 0
    pack, edited = out / "light.safetensors", tmp_path / "edited.safetensors"
    refused(ringlight("edit", other, edited, "--light", pack, "--quiet"), 1, pack, "belongs to another model")
    page = tmp_path / "page.html"
    refused(ringlight("share", other, page, "--light", pack, "--quiet"), 1, pack, "belongs to another model")
    for name, damage in (("cut", lambda data: data[:-9]), ("bent", lambda data: data[:-9] + b"x" * 9)):
        (tmp_path / name).write_bytes(damage(pack.read_bytes()))
        refused(ringlight("edit", run, edited, "--light", tmp_path / name, "--quiet"), 1, tmp_path / name)
    file = read_tensors(pack)
    for name, metadata in (
        ("nameless", {key: value for key, value in file.metadata.items() if key != "model"}),
        ("newer", file.metadata | {"format": "2"}),
        ("packed", file.metadata | {"packing": "[1]"}),
    ):
        write_tensors(tmp_path / name, file.tensors, metadata)
        refused(ringlight("edit", run, edited, "--light", tmp_path / name, "--quiet"), 1, tmp_path / name)
    write_tensors(tmp_path / "shaped", {"color.basis": torch.zeros(2, 3)}, file.metadata | {"packing": "{}"})
    refused(ringlight("edit", run, edited, "--light", tmp_path / "shaped", "--quiet"), 1, tmp_path / "shaped")
    assert not edited.exists()
    assert not page.exists()


@pytest.mark.parametrize(
    ("method", "shape"),
    [("ringlight-basis", "color.opacity_basis"), ("ringlight-mirror", "color.varying.opacity_basis")],
)
def test_what_moves_opacities_is_no_light(
    method: str, shape: str, trained: dict[str, Path], mirrors: dict[str, Path], tmp_path: Path
) -> None:
    stored = load_model((trained | mirrors)[method], host_rasterizer())
    tensors = stored.model.rendering_tensors()
    with pytest.raises(RunError, match=f"its {shape} is not that of the model"):
        pack_between(stored, tensors | {shape: tensors[shape] + 1}, "scene", tmp_path / "light.safetensors")
