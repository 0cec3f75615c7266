"""ringlight-mirror: reflections shaded once per pixel, on an opaque surface that is there from the first step.

Ours, after 3DGS-DR (Ye et al. 2024), which showed that blended normals shaded once per pixel make splatted reflections
sharp. Unlike it: the surface comes from the visual hull (``data/surface.py``), normals are free columns, and the
reflection is a small network's of octahedral features in the reflected direction, corrected for parallax
(``shade/reflection.py``).
"""

import dataclasses
import math
from dataclasses import dataclass
from typing import TYPE_CHECKING

from ringlight.fit.strategies.densify_settings import DensifySettings
from ringlight.methods.mirror_bounds import most_gaussians, most_without_hull
from ringlight.methods.mirror_settings import MirrorSettings
from ringlight.shade.reflection_settings import FINE_FROM, FINE_LEVELS, USUAL_LEVELS

if TYPE_CHECKING:
    from jaxtyping import Float
    from torch import Tensor

    from ringlight.color.contract import ColorModel
    from ringlight.core.scene import PointCloud, Scene
    from ringlight.fit.train import Training
    from ringlight.methods.assembly import Course
    from ringlight.methods.recipe import Recipe
    from ringlight.rasterize.contract import Rasterizer
    from ringlight.shade.contract import Shader

WARMUP_UNCARVED = 0.1
"""Share of the steps that show base colours alone where nothing is cut out: there the surface is not known before, and
150 steps of 7,000 cost family_24 1.0 dB."""


@dataclass(frozen=True)
class RingLightMirrorRecipe(MirrorSettings):
    """Deferred reflection shading on an opaque surface: for mirrors, chrome and clear coats."""

    def parts(self, box: "Float[Tensor, '2 3']", seed: int = 0) -> "tuple[ColorModel, Shader]":
        from ringlight.color.mirror import Mirror
        from ringlight.color.varying_mirror import VaryingMirror
        from ringlight.shade.reflection import ReflectionShader

        latents, size = self.shader.latents, self.basis_size
        color = VaryingMirror(latents, size, seed, self.varying_opacity) if size else Mirror(latents, seed)
        return color, ReflectionShader(self.shader, box, seed)

    def settled(self, scene: "Scene", rasterize: "Rasterizer", seed: int) -> "tuple[RingLightMirrorRecipe, None]":
        """With everything decided that depends on the run's length, and what depends on the photographs: how fine the
        maps are, and how long the warm-up."""
        from ringlight.data.surface import is_cut_out

        if self.shader.levels is not None and self.warmup is not None:
            return self.at_length(), None
        carved = is_cut_out(scene)
        levels = FINE_LEVELS if carved and scene.pixels >= FINE_FROM else USUAL_LEVELS
        longer = WARMUP_UNCARVED if self.warmup is None and not carved else self.warmup
        decided = dataclasses.replace(self, warmup=longer, shader=self.shader.for_levels(levels))
        return decided.at_length(), None

    def may_settle_on(self, other: "Recipe") -> bool:
        """See :meth:`SplatRecipe.may_settle_on`; with any maps, and any warm-up, that are left to photographs."""
        if not isinstance(other, RingLightMirrorRecipe):
            return False
        if self.shader.levels is None:
            other = dataclasses.replace(other, shader=other.shader.left_to_photographs())
        if self.warmup is None and other.warmup == WARMUP_UNCARVED:
            other = dataclasses.replace(other, warmup=self.unlit_share)
        return super().may_settle_on(other)

    def at_length(self) -> "RingLightMirrorRecipe":
        """See :meth:`SplatRecipe.at_length`."""
        settled = dataclasses.replace(super().at_length(), warmup=self.unlit_share)
        if not self.basis_size:
            return settled
        of_weights, of_basis, of_opacities = self.varying_rates
        settled = dataclasses.replace(settled, weights_rate=of_weights, basis_rate=of_basis)
        return dataclasses.replace(settled, opacity_basis_rate=of_opacities) if self.varying_opacity else settled

    def densify_on_hull(self, scene: "Scene") -> DensifySettings:
        """Density control of a subject that a hull cuts out."""
        return self.densify.within(most_gaussians(scene.pixels, len(scene.train)))

    def most_by_pixels(self, pixels: int) -> int:
        """See :meth:`SplatRecipe.most_by_pixels`; where no hull cuts the subject out."""
        adaptive = self.densify.kind == "adaptive"
        return most_without_hull(pixels) if adaptive else self.densify.usual_bound(pixels)

    def first_gaussians(self, scene: "Scene") -> int:
        """How many the run starts from where there is a hull to draw them from."""
        bounded = dataclasses.replace(self.densify, pixel_bound=True).within(
            most_gaussians(scene.pixels, len(scene.train))
        )
        most = bounded.most_growing(self.steps)
        return math.ceil(self.start_share * most)

    def build(self, scene: "Scene", rasterize: "Rasterizer", seed: int) -> "Training":
        from ringlight.data.surface import hull_points, own_points

        points = hull_points(scene, self.first_gaussians(scene), seed)
        if points is not None:
            return self.build_on_hull(points, scene, rasterize, seed)
        return self.build_on(own_points(scene), scene, rasterize, seed)

    def build_on_hull(self, points: "PointCloud", scene: "Scene", rasterize: "Rasterizer", seed: int) -> "Training":
        """The same from points of a hull that cuts the subject out."""
        bounded = dataclasses.replace(self, densify=self.densify_on_hull(scene))
        return bounded.build_on(points, scene, rasterize, seed)

    def course(self, scene: "Scene") -> "Course":
        from ringlight.methods.mirror_course import mirror_course

        return mirror_course(self)
