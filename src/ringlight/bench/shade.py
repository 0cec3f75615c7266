"""Speed of the reflection shader on a ball that covers a given number of pixels, beside its reference in torch."""

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import torch

from ringlight.bench.record import Circumstances
from ringlight.bench.timing import TOTAL, Budget, Contestant, Timing, interleaved
from ringlight.core.camera import Camera
from ringlight.core.gradients import Gradients
from ringlight.core.randomness import generator
from ringlight.core.rendering import Channels, Shaded
from ringlight.core.want import Want
from ringlight.errors import RecipeError
from ringlight.shade.reflection import ReflectionShader
from ringlight.shade.reflection_settings import ReflectionSettings

PIXELS = 400
"""Of the square image on a side."""
DISTANCE = 4.0
"""From the camera to the ball's centre, world units; the ball's box has sides of 2."""

SHOW, FORWARD, BACKWARD = "show", "forward", "backward"


@dataclass(frozen=True)
class ShadeRow:
    """One width on one ball. ``show`` wants no gradient, ``both`` is a step's, ``reference`` the same in torch."""

    hidden: int
    covered: int
    show: Timing
    forward: Timing
    backward: Timing
    both: Timing
    reference: Timing

    @property
    def nanoseconds_per_pixel(self) -> float:
        """Processor time of ``both``."""
        return 1e6 * self.both.cpu_ms / self.covered


@dataclass(frozen=True)
class ShadeBench:
    """What ``ringlight bench shade`` measured."""

    circumstances: Circumstances
    rows: tuple[ShadeRow, ...]


def bench_shade(hidden: Sequence[int], covered: int, budget: Budget, seed: int = 0) -> tuple[ShadeRow, ...]:
    """Time shaders of each width on a ball of about ``covered`` pixels. Raises RecipeError for more than there are."""
    if not 1 <= covered <= PIXELS**2 * math.pi / 4:
        raise RecipeError(f"a ball cannot cover {covered} of {PIXELS} x {PIXELS} pixels; give 1 to 125000")
    return tuple(_row(ReflectionSettings(hidden=width), covered, budget, seed) for width in hidden)


def ball(camera: Camera, covered: int, latents: int, seed: int) -> Channels:
    """Blended buffers of an opaque ball in the middle of the image, planar as the rasterizer leaves them."""
    radius = math.sqrt(covered / math.pi)
    rows, columns = torch.meshgrid(*(torch.arange(PIXELS) + 0.5 - PIXELS / 2 for _ in range(2)), indexing="ij")
    squared = (rows * rows + columns * columns) / radius**2
    height = (1 - squared).clamp_min(0).sqrt()
    drawn = generator(seed, 0, "ball")
    planes = {
        "rgb": torch.rand(3, PIXELS, PIXELS, generator=drawn),
        "normal": torch.stack([columns / radius, rows / radius, -height]),
        "latents": torch.randn(latents, PIXELS, PIXELS, generator=drawn),
        "depth": (DISTANCE - height)[None],
        "alpha": torch.ones(1, PIXELS, PIXELS),
    }
    return {name: (plane * (squared < 1)).permute(1, 2, 0) for name, plane in planes.items()}


def _row(settings: ReflectionSettings, covered: int, budget: Budget, seed: int) -> ShadeRow:
    focal, middle = float(PIXELS), PIXELS / 2
    camera = Camera(torch.eye(4), (focal, focal), (middle, middle), PIXELS, PIXELS)
    box = torch.tensor([[-1.0, -1.0, DISTANCE - 1], [1.0, 1.0, DISTANCE + 1]])
    shader, background = ReflectionShader(settings, box, seed), torch.ones(3)
    buffers = ball(camera, covered, settings.latents, seed)
    image = torch.cat([buffers[name].permute(2, 0, 1) for name in shader.needs]).permute(1, 2, 0)
    upstream = torch.randn(3, PIXELS, PIXELS, generator=generator(seed, 0, "upstream")).permute(1, 2, 0)

    def stages(shade: Callable[[], Shaded]) -> dict[str, Callable[[], object]]:
        shaded: list[Shaded] = []
        return {
            FORWARD: lambda: shaded.append(shade()),
            BACKWARD: lambda: shaded.pop().backward(upstream, Gradients()),
        }

    def native(want: Want) -> Shaded:
        return shader.shade(image, buffers["alpha"], camera, background, want)

    def by_torch() -> Shaded:
        return shader.shaded_by_torch(image, buffers["alpha"], camera, background, Want.GRADIENTS)

    contestants = {
        SHOW: Contestant({SHOW: lambda: native(Want.EXACT)}),
        "kernel": Contestant(stages(lambda: native(Want.GRADIENTS))),
        "reference": Contestant(stages(by_torch)),
    }
    timings = interleaved(contestants, budget)
    return ShadeRow(
        hidden=settings.hidden,
        covered=int((buffers["alpha"] > 0).sum()),
        show=timings[SHOW][SHOW],
        forward=timings["kernel"][FORWARD],
        backward=timings["kernel"][BACKWARD],
        both=timings["kernel"][TOTAL],
        reference=timings["reference"][TOTAL],
    )
