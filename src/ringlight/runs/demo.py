"""The demo: two methods on one bundled scene, side by side below one folder."""

import json
from dataclasses import dataclass, replace
from pathlib import Path

from ringlight.data.bundled import bundled_scene
from ringlight.data.options import SceneOptions
from ringlight.errors import RunError
from ringlight.files.atomic import write_text
from ringlight.measure.report import REPORT_NAME, read_report
from ringlight.methods.table import method_named
from ringlight.runs.folder import empty_folder
from ringlight.runs.record import RECORD_NAME
from ringlight.runs.resume import resume_run
from ringlight.runs.session import Session
from ringlight.runs.start import Loaded, nobody, start_run

METHODS_SHOWN = ("3dgs", "ringlight")
"""In the order in which they are trained and shown: the yardstick first."""

PLAN_NAME = "demo.json"
SHEET_NAME = "contact_sheet.png"
REPORT_PAGE, SHARED_PAGE = "report.html", "share.html"


@dataclass(frozen=True)
class Demo:
    """``folder`` holds demo.json, a run folder for each method, the contact sheet and two pages.

    demo.json keeps what is trained, so that the demo can go on after an interrupt.
    """

    folder: Path
    scene: str
    steps: int
    seed: int

    @staticmethod
    def create(folder: Path, scene: str, steps: int, seed: int) -> "Demo":
        """A new demo. Raises SceneError for an unknown scene, RunError if the folder holds anything."""
        bundled_scene(scene)
        empty_folder(folder)
        plan = {"scene": scene, "steps": steps, "seed": seed}
        write_text(folder / PLAN_NAME, json.dumps(plan, indent=2) + "\n")
        return Demo(folder, scene, steps, seed)

    @staticmethod
    def open(folder: Path) -> "Demo":
        """A demo that was begun. Raises RunError where there is none."""
        path = folder / PLAN_NAME
        try:
            values = json.loads(path.read_text(encoding="utf-8"))
            return Demo(folder, str(values["scene"]), int(values["steps"]), int(values["seed"]))
        except FileNotFoundError:
            raise RunError(f"{folder}: holds no {PLAN_NAME}; start a demo with 'ringlight demo'") from None
        except (OSError, ValueError, KeyError, TypeError, OverflowError, RecursionError) as error:
            reason = f"{type(error).__name__}: {error}"
            raise RunError(f"{path}: cannot be understood ({reason}); start a new one with 'ringlight demo'") from None

    @property
    def runs(self) -> tuple[Path, ...]:
        """The run folders."""
        return tuple(self.folder / method for method in METHODS_SHOWN)

    @property
    def sheet(self) -> Path:
        """The picture with both methods side by side."""
        return self.folder / SHEET_NAME

    @property
    def report(self) -> Path:
        """The page about both runs."""
        return self.folder / REPORT_PAGE

    @property
    def shared(self) -> Path:
        """The page that shows the last method's model itself."""
        return self.folder / SHARED_PAGE

    def session(self, method: str, loaded: Loaded = nobody) -> Session | None:
        """The training of ``method``, from its start or from where it stopped; None if it has been measured.

        ``loaded`` hears of the scene.
        """
        folder = self.folder / method
        # eval measures runs that were stopped, too.
        if (folder / REPORT_NAME).exists() and read_report(folder).iterations == self.steps:
            return None
        if (folder / RECORD_NAME).exists():
            return resume_run(folder, loaded=loaded)
        recipe = replace(method_named(method), steps=self.steps)
        scene = bundled_scene(self.scene)
        session = start_run(folder, scene, method, recipe, SceneOptions(), self.seed, "auto", loaded=loaded)
        # From here on there is something to resume from, whatever happens.
        session.save()
        return session
