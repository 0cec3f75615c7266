"""How to get the same run again: the commands that say its settings."""

from ringlight.core.command_line import command
from ringlight.data.bundled import BUNDLED, FOLDER
from ringlight.runs.changed_settings import method_asked, options_changed, settings_changed
from ringlight.runs.record import RunRecord
from ringlight.runs.relight import relights


def commands(record: RunRecord) -> list[str]:
    """The lines that train the same again: the first run, then each time that it was extended."""
    alike = ["--seed", str(record.seed)]
    alike += ["--device", record.device] if record.device != "auto" else []
    if record.start is not None and relights(record):
        named = (record.start, _scene_named(record), "AGAIN", "--steps", str(record.recipe.steps))
        first = command("relight", *named, *alike)
    else:
        first = command("train", *_asked_for(record), *alike, *_started_from(record), "--out", "AGAIN")
    return [first, *(command("train", "--resume", "AGAIN", "--steps", str(steps)) for steps in record.added)]


def _asked_for(record: RunRecord) -> list[str]:
    """Scene, method, and what of both is not the default."""
    words = [_scene_named(record), method_asked(record.preset, record.recipe)]
    for setting in settings_changed(record):
        words += setting.words
    for option in options_changed(record):
        words += option.words if not isinstance(option.value, bool) else (f"--{option.name.replace('_', '-')}",)
    return words


def _started_from(record: RunRecord) -> list[str]:
    return [] if record.start is None else ["--from", record.start]


def _scene_named(record: RunRecord) -> str:
    """The folder, or the name of a scene that every installation has."""
    bundled = {FOLDER / name: name for name in BUNDLED}
    return bundled.get(record.scene, str(record.scene))
