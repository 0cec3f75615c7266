"""What light-gaussian does to a training of 3dgs: fewer Gaussians, a teacher, a codebook."""

from collections.abc import Mapping
from dataclasses import replace
from functools import partial

from jaxtyping import Float
from torch import Tensor

from ringlight.core.scene import Scene
from ringlight.data.batches import ImageBatches
from ringlight.data.moved_cameras import MovedCameras
from ringlight.files.packed import pack_tensors, unpack_tensors
from ringlight.files.packing_plan import Plan
from ringlight.fit.losses.photographs import PhotographLoss
from ringlight.fit.losses.teacher_pictures import TeacherPictures
from ringlight.fit.optimizer import Optimizer
from ringlight.fit.strategies.distill_harmonics import DistillHarmonics
from ringlight.fit.strategies.drop_insignificant import DropInsignificant
from ringlight.fit.strategies.global_significance import global_significance
from ringlight.fit.strategies.quantize_colors import QuantizeColors
from ringlight.fit.strategies.removal_effects import removal_effects
from ringlight.fit.teacher import Teacher
from ringlight.fit.train import Training
from ringlight.methods.assembly import empty_model
from ringlight.methods.light_gaussian import LightGaussianRecipe
from ringlight.models.narrowed_splats import narrowed_splats
from ringlight.models.splats import SplatModel
from ringlight.rasterize.contract import Rasterizer


def lightened(
    recipe: LightGaussianRecipe, growing: Training, scene: Scene, rasterize: Rasterizer, seed: int
) -> Training:
    """The training ``growing`` of 3dgs as the first steps of one by ``recipe``, which is settled; without them where
    nothing is grown."""
    splats = growing.model.splats()
    assert splats is not None
    assert isinstance(growing.batches, ImageBatches)
    model = narrowed_splats(splats, recipe.distilled_degree)
    if not recipe.grown:
        model.get_buffer("color.active_degree").fill_(recipe.sh_degree)
    teacher = Teacher(empty_model(recipe._as_3dgs(recipe.steps), scene.box, rasterize))
    jitter = recipe.view_jitter * scene.extent
    return replace(
        growing,
        model=model,
        batches=MovedCameras(growing.batches, recipe.recovered, recipe.steps, jitter, seed),
        loss=TeacherPictures(PhotographLoss(recipe.loss, rasterize.device), teacher, not recipe.photographs_teach),
        optimizer=Optimizer(model, recipe.groups(scene), recipe.steps, recipe.visible_only),
        strategies=(*(growing.strategies if recipe.grown else ()), *_lightening(recipe, scene, teacher, seed)),
        steps=recipe.steps,
    )


def _lightening(
    recipe: LightGaussianRecipe, scene: Scene, teacher: Teacher, seed: int
) -> tuple[DropInsignificant, DistillHarmonics, QuantizeColors]:
    cameras, power = [view.camera for view in scene.train], recipe.volume_power

    def worth(model: SplatModel, step: int) -> Float[Tensor, "N"]:
        if recipe.prune_by == "significance":
            return global_significance(model, cameras, power)
        return removal_effects(model, cameras, scene.background_color, seed, step)

    return (
        DropInsignificant(recipe.prune_steps(), recipe.prune_share, worth),
        DistillHarmonics(teacher, recipe.recovered, recipe.steps, recipe.distilled_degree, cameras),
        QuantizeColors(
            recipe.steps, recipe.codebook_share, recipe.codebook_size, cameras, power,
            partial(as_files_hold, plan=recipe.packings), seed,
        ),
    )  # fmt: skip


def as_files_hold(tensors: Mapping[str, Tensor], plan: Plan) -> dict[str, Tensor]:
    """The same after a file. Twice, for positions are packed by how wide the Gaussians in the file are."""
    for _ in range(2):
        tensors = unpack_tensors(pack_tensors(tensors, plan))
    return dict(tensors)
