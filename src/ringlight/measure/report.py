"""The record of one run: what was trained, how well it shows held-out views, what it costs. One JSON file per run."""

from dataclasses import dataclass
from pathlib import Path

from ringlight.core.command_line import command
from ringlight.errors import RunError
from ringlight.measure.json_record import from_json
from ringlight.measure.machine import Machine

REPORT_NAME = "report.json"

# Two thousand test views take about 1 MB; more than this is not a report, and is not read into memory.
MAX_REPORT_BYTES = 64_000_000

MOST_NAMED = 5
"""Folders that a sentence names."""


@dataclass(frozen=True)
class ImageScore:
    """The measures of one test view; conventions in ``measure/metrics.py``. None: not measured."""

    name: str
    psnr: float
    psnr_u8: float
    ssim_same: float
    ssim_valid: float
    lpips_alex: float | None = None
    lpips_vgg: float | None = None
    lpips_vgg_01: float | None = None


@dataclass(frozen=True)
class GivenSetting:
    """A setting that is no default, as text: "on", "off" for switches, "left open" for what nothing decided. Without a
    ``default`` it stands for what most runs have not."""

    value: str
    default: str | None = None


@dataclass(frozen=True)
class CurvePoint:
    """A training after ``step``: ``seconds`` in steps so far, ``psnr`` in dB over a few training photographs before
    it, ``counted`` of what the model is made of, and the ``loss`` with all its terms over the same photographs, None
    in runs of earlier versions."""

    step: int
    seconds: float
    psnr: float
    counted: int
    loss: float | None = None


@dataclass(frozen=True, kw_only=True)
class Report:
    """Everything one run states about itself. None: not measured, or not known for a model from elsewhere."""

    method: str
    preset: str
    version: str
    """Of ringlight."""
    commit: str | None
    """Of ringlight's checkout when its last session, or else the measuring, began; None for an installed copy."""
    seed: int | None
    dataset: str
    """Format of the scene: "blender", "colmap", "nerfstudio", ..."""
    scene: str
    split: str
    """How many views train and how many test; ``notes`` has the rule."""
    resolution: str
    """Of the test views: "400x400", or the smallest and largest, "976x541..980x545"; without any, of training views."""
    background: str
    notes: tuple[str, ...]
    """What the loader decided: downscaling and its filter, sub-model, ..."""
    iterations: int | None
    """Steps of training that were done."""
    planned: int | None
    """Steps of the whole run; more than ``iterations`` for a run that was stopped."""
    settings: dict[str, GivenSetting] | None = None
    """What of the training was not the default of the preset, or of the method that this chose, in the version of
    ``commit``: by a flag, by the scene or by the length of the run. By dotted names; "added" are steps by which the run
    was extended, "from" is the model that it started from. None in records of before, and for a model without its
    run."""

    psnr: float | None
    """dB, mean over images, float. None, as all others of test views, where the scene has none."""
    psnr_u8: float | None
    """The same on images rounded to 8 bit."""
    psnr_pooled: float | None
    """dB of the squared error pooled over all test images."""
    psnr_train: float | None = None
    """The same as ``psnr`` on training views: as many as there are test views, or all if fewer, evenly spread; without
    test views up to 20. None
    where the model was trained on none of the scene's, or a photograph of them cannot be read."""
    psnr_thirds: tuple[float, ...] | None = None
    """``psnr`` over the third of the test views whose cameras lie nearest to a training camera, the middle third, and
    the farthest; None for fewer than three views."""
    test_views_trained_on: int = 0
    """How many of the test views the model was trained on, as where a scene is split in another way since: its numbers
    are then those of training views in part."""
    ssim_same: float | None
    ssim_valid: float | None
    lpips_alex: float | None
    lpips_vgg: float | None
    lpips_vgg_01: float | None
    """VGG on [0, 1] without rescaling: wrong, but what most tables of the 3DGS family print."""
    lpips_note: str
    """Why a LPIPS is missing and how to get it; empty if the wanted ones were measured."""

    saturated_features: float | None = None
    """Share of the light's features, 0 to 1, that are at an end of their range on nearly all of what training views
    show, where they learn no more; None without a neural light. Features of maps have no range and count as not."""
    constant_features: float | None = None
    """Share of those that hardly vary over what training views show, so that they say nothing. The limits stand in
    ``core/light_features.py``."""
    hidden_units_off: float | None = None
    """Share of the hidden units of the network behind the features that are zero on nearly all of it. A quarter is so
    when a network is drawn, and a tenth after healthy runs."""

    collapses: tuple[str, ...] = ()
    """What happened each time that the light collapsed while it trained, a sentence each: where training went back to,
    and with what rates it went on. ``train_seconds`` counts the steps that were undone too."""

    counted: int
    """What rendering needs of what the model is made of: Gaussians, voxels."""
    noun: str
    """What these are."""
    bytes_raw: int
    """Everything rendering needs, floats at 32 bit: the sum of ``bytes_by_part``."""
    bytes_by_part: dict[str, int]
    bytes_file: int | None
    """The model file on disk."""
    train_seconds: float | None
    """Wall clock with densification, without data loading and test renders."""
    train_cpu_seconds: float | None
    saving_seconds: float | None
    """Wall clock of checkpoints, the last one included; not among ``train_seconds``."""
    choosing_cpu_seconds: float | None = None
    """Before the first step: photographs decoded, the trial that chose the method, the hull carved, the model made; not
    among ``train_cpu_seconds``. Until 2026-11-22 the trial alone."""
    steps_per_second: float | None
    peak_bytes: int | None
    """Most resident memory of the host from before the scene was loaded to the last step, above what it was then."""
    training_bytes: dict[str, int]
    """What lay on the device that trained at the end, step or no step: parameters, moments, the photographs seen since
    the run was started or resumed, what strategies count. Without a GPU it is part of ``peak_bytes``."""
    fps: float | None
    fps_note: str
    """What ``fps`` times, and on what device."""
    machine: Machine
    images: tuple[ImageScore, ...]
    curve: tuple[CurvePoint, ...] = ()
    """How the training went, in the order of its steps; empty where that is not known."""

    @property
    def psnr_far(self) -> float | None:
        """``psnr`` over the third of the test views that lies farthest from the training cameras."""
        return self.psnr_thirds[-1] if self.psnr_thirds else None

    @property
    def core_seconds(self) -> float | None:
        """CPU seconds of the training and of the trial before it."""
        if self.train_cpu_seconds is None:
            return None
        return self.train_cpu_seconds + (self.choosing_cpu_seconds or 0.0)


def read_report(run: Path) -> Report:
    """The report of a run folder.

    Raises:
        RunError: there is no report, or it cannot be read.
    """
    path, again = run / REPORT_NAME, command("eval", run)
    if not run.is_dir():
        raise RunError(
            f"{run}: no such run folder; give the folder of a run, which 'ringlight train' or 'relight' wrote"
        )
    if not path.is_file() and (inside := folders_with(REPORT_NAME, run)):
        raise RunError(f"{run}: is no run itself; name the runs inside it: {inside}")
    if not path.is_file():
        raise RunError(f"{run}: holds no {REPORT_NAME}; make one with: {again}")
    try:
        if path.stat().st_size > MAX_REPORT_BYTES:
            raise RunError(f"{path}: larger than any report; make a new one with: {again}")
        text = path.read_text(encoding="utf-8")
    except (OSError, UnicodeDecodeError) as error:
        raise RunError(f"{path}: cannot be read ({error}); make a new one with: {again}") from None
    return from_json(Report, text, str(path))


def folders_with(file: str, folder: Path) -> str:
    """The folders inside ``folder`` that hold ``file``, right there or else where a table has its runs, for a sentence;
    empty if there are none."""
    places = (sorted(path.parent for path in folder.glob(f"{inside}/{file}")) for inside in ("*", "*/*/*"))
    found = next(filter(None, places), [])
    shown = ", ".join(map(str, found[:MOST_NAMED]))
    return shown + (", ..." if len(found) > MOST_NAMED else "")
