"""Does a scene reflect? Two short trainings on its visual hull tell: what the reflection shader gains over harmonics.

Both start from the same opaque surface and see the same small photographs, so that their difference, on photographs
that neither has seen, is that of the colour models. On mirrors and clear coats it is several dB; on matte surfaces the
shader, with more freedom to learn single photographs by heart, gains little or loses.
"""

import math
from dataclasses import dataclass, replace
from statistics import fmean
from typing import Literal

from jaxtyping import Float
from torch import Tensor

from ringlight.core.scene import PointCloud, Scene, View
from ringlight.core.stages import counted as counted_views
from ringlight.core.stages import tell
from ringlight.core.words import counted
from ringlight.data.border_masks import on_even_background
from ringlight.data.hull import masks_of
from ringlight.data.points import FEWEST_FOR_BOX
from ringlight.data.shrunk import shrunk
from ringlight.data.surface import guessed_masks, is_cut_out, points_on_hull
from ringlight.fit.train import Training, train
from ringlight.measure.metrics import psnr
from ringlight.methods.ringlight_mirror import RingLightMirrorRecipe
from ringlight.methods.surface_start import FEWEST_VIEWS, SurfaceStart
from ringlight.methods.three_dgs import PAPER_DC_RATE, PAPER_REST_RATE, ThreeDGSRecipe
from ringlight.rasterize.contract import Rasterizer

STEPS = 1000
"""Of each training: what harmonics cannot show is plain by then, and both together take some seconds. With 600 a chrome
toaster gained hardly more than a matte chair (docs/experiments/choosing.md)."""

SIDE = 200
"""Pixels: photographs are shrunk until neither side is longer."""

HELD_OUT_EVERY = 10
"""Photographs of which one is kept from both trainings, and compared with."""

LEAST_GAIN = 1.0
"""dB, from which on a scene counts as reflecting. Matte scenes gained at most 0.4, mirrors and coats at least 1.5."""


FLATTEST = 2 / 255
"""Range of the colours of a photograph that shows something: less is a lens cap's noise, or rounding."""


@dataclass(frozen=True)
class ReflectionTrial:
    """PSNR in dB on held-out photographs, after ``steps`` steps from the same surface; harmonics from the scene's own
    points where those reach more and the masks were guessed."""

    steps: int
    harmonics: float
    reflections: float

    @property
    def reflects(self) -> bool:
        """Whether the shader is worth its surface."""
        return self.reflections - self.harmonics >= LEAST_GAIN

    def __str__(self) -> str:
        gain = self.reflections - self.harmonics
        short = (
            f"; reflections must gain {LEAST_GAIN:g} dB and gained {math.floor(100 * gain) / 100:.2f}"
            if 0 < gain < LEAST_GAIN
            else ""
        )
        unsure = ", too few to be sure," if self.steps < STEPS else ""
        remedy = (
            f"; from --steps {STEPS} on it is sure, and ringlight-mirror takes no trial" if short and unsure else ""
        )
        return (
            f"in a trial of {counted(self.steps, 'step')}{unsure} likeness to photographs kept apart was "
            f"{self.reflections:.1f} dB with reflections and {self.harmonics:.1f} dB without{short}{remedy}"
        )


def chosen_shading(
    scene: Scene, rasterize: Rasterizer, seed: int, most_steps: int
) -> tuple[Literal["basis", "mirror", "harmonics"], str]:
    """How to light a scene, and why.

    Where nothing cuts the subject out there is no surface to try on. From enough points on one, light per pixel had
    more PSNR than the ring, and than 3DGS at its paper's rates, on every scene measured
    (docs/experiments/without-masks.md).
    """
    if len(scene.train) < FEWEST_VIEWS:
        return "harmonics", f"fewer than {FEWEST_VIEWS} photographs"
    if _show_nothing(scene):
        return "harmonics", "each photograph is of one colour"
    trial = reflection_trial(scene, rasterize, seed, most_steps)
    if trial is not None:
        return "mirror" if trial.reflects else "basis", str(trial)
    if is_cut_out(scene):
        return "harmonics", "masks or background leave nothing of the subject where the cameras look"
    nothing_to_carve = "no masks and no even background cut the subject out"
    if not scene.points.measured or len(scene.points.positions) < FEWEST_FOR_BOX:
        return "basis", f"{nothing_to_carve}, and fewer than {FEWEST_FOR_BOX} points are known on it"
    return "mirror", f"{nothing_to_carve}, so that it begins from the scene's points"


def reflection_trial(scene: Scene, rasterize: Rasterizer, seed: int, most_steps: int) -> ReflectionTrial | None:
    """The trial, of at most ``most_steps``; None where photographs have neither masks nor an even background, by which
    a hull could be carved."""
    views = [_small(view) for view in scene.train]
    held = views[::HELD_OUT_EVERY]
    kept = tuple(view for index, view in enumerate(views) if index % HELD_OUT_EVERY)
    small = replace(scene, train=kept)
    # As when LEAST_GAIN was found: a longer warm-up, rates that fall all along, normals as they come, the last model.
    steps = min(STEPS, most_steps)
    mirror = RingLightMirrorRecipe(steps=steps, warmup=0.1, basis_size=0, light_hold=0.0, consistency=0.0, average=0.0)
    masks = masks_of(small.train)
    if not masks and not on_even_background(scene.train, scene.background_color):
        return None  # shrinking averages noise away, and the run must find them too
    points = points_on_hull(masks or guessed_masks(small), small, mirror.first_gaussians(small), seed)
    if points is None:
        return None
    behind = scene.background_color
    rounds = _Rounds(2 if masks else 3, mirror.steps)
    harmonics = _psnr_after(_harmonics(points, small, mirror, rasterize, seed), held, behind, rounds)
    if not masks:  # a hull that is torn is worse than none, whatever is shaded on it
        own = _harmonics(small.points, small, mirror, rasterize, seed)
        harmonics = max(harmonics, _psnr_after(own, held, behind, rounds))
    reflections = _psnr_after(mirror.build_on_hull(points, small, rasterize, seed), held, behind, rounds)
    return ReflectionTrial(mirror.steps, harmonics, reflections)


def _show_nothing(scene: Scene) -> bool:
    images = (view.image(scene.background_color).flatten(1) for view in scene.train)
    return all(bool((image.amax(1) - image.amin(1) <= FLATTEST).all()) for image in images)


def _small(view: View) -> View:
    factor = math.ceil(max(view.camera.width, view.camera.height) / SIDE)
    return shrunk(view, factor) if factor > 1 else view


def _harmonics(
    points: PointCloud, scene: Scene, mirror: RingLightMirrorRecipe, rasterize: Rasterizer, seed: int
) -> Training:
    """3DGS on the surface that the mirror starts from, if points have normals as opaque; as many Gaussians, their
    geometry as fast, no resets either. Their rates are 3DGS's, which are slow for so short a run: mirrors and matte
    scenes are told apart by what they gain over these."""
    recipe = ThreeDGSRecipe(
        steps=mirror.steps,
        coarse_steps=0,
        start=SurfaceStart(opacity=mirror.opacity),
        densify=mirror.densify_on_hull(scene),
        antialiased=mirror.antialiased,
        rates=mirror.rates,
        sh_rate=PAPER_DC_RATE,
        sh_rest_rate=PAPER_REST_RATE,
    )
    return recipe.build_on(points, scene, rasterize, seed)


@dataclass
class _Rounds:
    """How far the trainings of a trial are, for whoever listens."""

    trainings: int
    steps: int
    done: int = 0

    def step(self) -> None:
        self.done += 1
        tell("trying with and without reflections", self.done, self.trainings * self.steps)


def _psnr_after(training: Training, held: list[View], background: Float[Tensor, "3"], rounds: _Rounds) -> float:
    """Train, then compare the views with their photographs."""
    for _ in train(training):
        rounds.step()
    return fmean(
        psnr(
            training.model.render(view.camera, background).color.cpu().clamp(0, 1),
            view.image(background).permute(1, 2, 0),
        )
        for view in counted_views("comparing the trial's pictures", held)
    )
