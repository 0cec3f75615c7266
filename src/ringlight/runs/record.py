"""recipe.json: everything that decides a run's numbers. Torch-free."""

import dataclasses
import json
from dataclasses import dataclass
from pathlib import Path

from ringlight.core.lost_disk import what_helps
from ringlight.data.options import SceneOptions
from ringlight.errors import RecipeError, RunError
from ringlight.files.atomic import write_text
from ringlight.methods.recipe import Recipe, recipe_from_dict, recipe_to_dict
from ringlight.methods.table import method_of, recipe_of_method

RECORD_NAME = "recipe.json"

MOST_STEPS = 2**31 - 1
"""Of a run: checkpoints count no further."""

MOST_EXTENSIONS = 10_000
"""In a record: more are damage."""

LARGEST_SEED = 2**63 - 1
"""torch's generators take no more."""


def _recipe(method: str, settings: object, path: Path) -> Recipe:
    try:
        return recipe_of_method(method, settings, str(path))
    except KeyError:
        sentence = f"{path}: method {method!r} is unknown to this version of ringlight; update it, or train again"
        raise RunError(sentence) from None


def _added(value: object) -> tuple[int, ...]:
    """Raises ValueError for anything but numbers of steps, of which none is so large that their sum is damaged."""
    if not isinstance(value, list) or len(value) > MOST_EXTENSIONS:
        raise ValueError("its added steps are no list of numbers")
    if not all(type(steps) is int and 1 <= steps <= MOST_STEPS for steps in value):
        raise ValueError(f"its added steps are not all from 1 to {MOST_STEPS}")
    return tuple(value)


def _seed(value: object) -> int:
    if type(value) is not int or not 0 <= value <= LARGEST_SEED:
        raise ValueError(f"its seed is no whole number from 0 to {LARGEST_SEED}")
    return value


@dataclass(frozen=True)
class RunRecord:
    """What was asked for: the method's settings, the scene and how it was read, the seed, the back end.

    ``recipe`` may be of another method than ``preset``, where that one left the choice to the scene. ``added`` are the
    steps by which the run was extended, one number each time; ``start`` is the file of the model that it started from,
    None where it started from points.
    """

    preset: str
    recipe: Recipe
    scene: Path
    options: SceneOptions
    seed: int
    device: str
    version: str
    added: tuple[int, ...] = ()
    start: str | None = None

    @property
    def steps(self) -> int:
        """The length of the run with all that was added."""
        return self.recipe.steps + sum(self.added)

    @property
    def made_by(self) -> str:
        """What a checkpoint of it is told apart by, besides shapes."""
        return f"{method_of(self.recipe)} with seed {self.seed}"

    def extended(self, steps: int) -> "RunRecord":
        """The same with ``steps`` added to the run. Raises RecipeError for what is no number of steps."""
        if not 1 <= steps <= MOST_STEPS - self.steps:
            raise RecipeError(f"--steps is {steps}; give at least 1 and at most {MOST_STEPS - self.steps} more")
        return dataclasses.replace(self, added=(*self.added, steps))

    def write(self, folder: Path) -> None:
        """Write recipe.json into the run folder, all or nothing. Raises RecipeError as :meth:`to_json`."""
        write_text(folder / RECORD_NAME, self.to_json())

    def to_json(self) -> str:
        """What recipe.json holds. Raises RecipeError for a setting that JSON has not: infinity, or no number."""
        values = {
            "preset": self.preset,
            "method": method_of(self.recipe),
            "recipe": recipe_to_dict(self.recipe),
            "scene": str(self.scene),
            "options": dataclasses.asdict(self.options),
            "seed": self.seed,
            "device": self.device,
            "version": self.version,
            **({"added": list(self.added)} if self.added else {}),
            **({"start": self.start} if self.start is not None else {}),
        }
        try:
            return json.dumps(values, indent=2, allow_nan=False) + "\n"
        except ValueError:
            raise RecipeError(
                f"{RECORD_NAME}: a setting of {self.preset} or of the scene is infinite or no number; give a finite one"
            ) from None

    @staticmethod
    def read(folder: Path) -> "RunRecord":
        """The record of a run folder. Raises RunError for one that is missing or damaged, or of a method or setting
        that this version does not know."""
        path = folder / RECORD_NAME
        try:
            values = json.loads(path.read_text(encoding="utf-8"))
            return RunRecord(
                preset=str(values["preset"]),
                recipe=_recipe(str(values["method"]), values["recipe"], path),
                scene=Path(values["scene"]),
                options=recipe_from_dict(SceneOptions, values["options"], f"{path}.options"),
                seed=_seed(values["seed"]),
                device=str(values["device"]),
                version=str(values["version"]),
                added=_added(values.get("added", [])),
                start=None if values.get("start") is None else str(values["start"]),
            )
        except FileNotFoundError:
            raise RunError(
                f"{folder}: holds no run ({RECORD_NAME} is missing); give a folder that train made"
            ) from None
        except RecipeError as error:  # of settings that nobody asks for now: the folder is at fault
            raise RunError(str(error)) from error
        except OSError as error:
            check = what_helps(error, "check its permissions")
            raise RunError(f"{path}: cannot be read ({error.strerror}); {check}") from None
        except (ValueError, KeyError, TypeError, AttributeError, RecursionError) as error:
            reason = f"{type(error).__name__}: {error}"
            raise RunError(f"{path}: cannot be understood ({reason}); start the run again with --out NEW") from None
