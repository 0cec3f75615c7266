"""``ringlight train SCENE METHOD --verify N``: prove on this machine that a run repeats itself, and write nothing."""

import sys
from pathlib import Path

from ringlight.cli.loading import tell_warnings
from ringlight.cli.main import WRONG_INPUT
from ringlight.core.words import counted
from ringlight.data.options import SceneOptions
from ringlight.errors import RecipeError
from ringlight.methods.recipe import Recipe

MOST_NAMED = 5
"""Tensors that a line names."""


def verify_run(
    scene_path: Path, options: SceneOptions, recipe: Recipe, seed: int, device: str, steps: int, as_json: bool
) -> int:
    """Print one line a trial on standard output, or all as JSON; the exit code is 1 where any differs from the first.

    Raises RecipeError for a number of steps that cannot be compared.
    """
    if not 2 <= steps <= recipe.steps:
        raise RecipeError(f"--verify is {steps}; give 2 to {counted(recipe.steps, 'step')}, as many as this run has")
    from ringlight.cli.threads import use_threads
    from ringlight.data.load import load_scene
    from ringlight.measure.json_record import to_json
    from ringlight.rasterize.choose import refuse_without_gpu
    from ringlight.runs.limits import prepare_run
    from ringlight.runs.starting_points import with_points_of
    from ringlight.runs.verify import verify

    refuse_without_gpu(device)  # before photographs are read, which takes long
    scene = load_scene(scene_path, with_points_of(recipe, options))
    tell_warnings(scene)
    prepared = prepare_run(scene, recipe, seed, device)
    for warning in prepared.warnings:
        sys.stderr.write(f"warning: {warning}\n")
    recipe, scene = prepared.recipe, prepared.scene
    del prepared  # and with it a training that nobody runs: memory was planned for one at a time
    trials = []
    for trial in verify(recipe, scene, seed, device, steps, use_threads):
        trials.append(trial)
        if as_json:
            continue
        verdict = "the same bits" if trial.is_same else "OTHER BITS"
        sys.stdout.write(f"{trial.digest}  {verdict}  {trial.circumstances}\n")
        sys.stdout.flush()
        if not trial.is_same:
            sys.stdout.write(f"{'':18}{_where(trial.first_step, trial.differing)}\n")
    all_same = all(trial.is_same for trial in trials)
    if as_json:
        sys.stdout.write(to_json({"same": all_same, "trials": trials}))
    return 0 if all_same else WRONG_INPUT


def _where(step: int | None, differing: tuple[str, ...]) -> str:
    loss = "losses agree" if step is None else f"the first loss that differs is that of step {step}"
    names = ", ".join(differing[:MOST_NAMED]) + ", ..." * (len(differing) > MOST_NAMED)
    return loss + (f"; other at the end: {counted(len(differing), 'tensor')}, {names}" if differing else "")
