"""recipe.json: everything that decides a run's numbers. Torch-free."""

import dataclasses
import json
from dataclasses import dataclass
from pathlib import Path

from ringlight.data.options import SceneOptions
from ringlight.errors import RinglightError, RunError
from ringlight.files.atomic import write_text
from ringlight.methods.recipe import Recipe, recipe_from_dict, recipe_to_dict
from ringlight.methods.table import method_of, recipe_of_method

RECORD_NAME = "recipe.json"

LARGEST_SEED = 2**63 - 1
"""torch's generators take no more."""


def _recipe(method: str, settings: object, path: Path) -> Recipe:
    try:
        return recipe_of_method(method, settings, str(path))
    except KeyError:
        sentence = f"{path}: method {method!r} is unknown to this version of ringlight; update it, or train again"
        raise RunError(sentence) from None


def _seed(value: object) -> int:
    if type(value) is not int or not 0 <= value <= LARGEST_SEED:
        raise ValueError(f"its seed is no whole number from 0 to {LARGEST_SEED}")
    return value


@dataclass(frozen=True)
class RunRecord:
    """What was asked for: the method's settings, the scene and how it was read, the seed, the back end.

    ``recipe`` may be of another method than ``preset``, where that one left the choice to the scene.
    """

    preset: str
    recipe: Recipe
    scene: Path
    options: SceneOptions
    seed: int
    device: str
    version: str

    def write(self, folder: Path) -> None:
        """Write recipe.json into the run folder, all or nothing."""
        values = {
            "preset": self.preset,
            "method": method_of(self.recipe),
            "recipe": recipe_to_dict(self.recipe),
            "scene": str(self.scene),
            "options": dataclasses.asdict(self.options),
            "seed": self.seed,
            "device": self.device,
            "version": self.version,
        }
        write_text(folder / RECORD_NAME, json.dumps(values, indent=2) + "\n")

    @staticmethod
    def read(folder: Path) -> "RunRecord":
        """The record of a run folder. Raises RunError for one that is missing, damaged or of an unknown method."""
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
            )
        except FileNotFoundError:
            raise RunError(
                f"{folder}: holds no run ({RECORD_NAME} is missing); give a folder that train made"
            ) from None
        except RinglightError:
            raise
        except (OSError, ValueError, KeyError, TypeError, AttributeError, RecursionError) as error:
            reason = f"{type(error).__name__}: {error}"
            raise RunError(f"{path}: cannot be understood ({reason}); start the run again with --out NEW") from None
