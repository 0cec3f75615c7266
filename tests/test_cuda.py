"""What only a GPU can show: training there, and the same model on both devices. Skipped without one."""

import pytest
import torch

from ringlight.core.scene import Scene
from ringlight.data import hull
from ringlight.fit.train import Training, train
from ringlight.measure.metrics import psnr
from ringlight.methods.table import METHODS
from ringlight.rasterize.choose import rasterizer_for
from ringlight.volume import halves
from small_recipes import COARSE, TRAINED, with_settings
from tiny_scene import tiny_scene

pytestmark = pytest.mark.cuda

STEPS = 200

ALIKE = 60
"""dB between the pictures of one model on both devices; needs gsplat 1.5, whose clamp is ours."""

AS_GOOD = 1.0
"""dB on held-out views between a training on each device: chance, after so few steps."""


def built(method: str, scene: Scene, device: str, visible_only: bool = False) -> Training:
    recipe = with_settings(METHODS[method], COARSE | {"steps": STEPS, "visible_only": visible_only})
    return recipe.build(scene, rasterizer_for(device), seed=0)


def pictures(training: Training, scene: Scene) -> list[torch.Tensor]:
    with torch.no_grad():
        shown = [training.model.render(view.camera, scene.background_color).color.cpu() for view in scene.test]
    return [picture.clamp(0, 1) for picture in shown]


@pytest.mark.parametrize("visible_only", [False, True])
@pytest.mark.parametrize("method", TRAINED)
def test_a_model_trained_there_is_drawn_here(method: str, visible_only: bool, monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setattr(hull, "FINE_CELLS", 48)
    monkeypatch.setattr(halves, "HALVES", False)  # a CPU may multiply bfloat16 numbers in volumes, the GPU does not
    scene = tiny_scene(views=16, size=64)
    there, here = built(method, scene, "cuda", visible_only), built(method, scene, "cpu", visible_only)
    for training in (there, here):
        for _ in train(training):
            pass
    assert all(parameter.is_cuda for parameter in there.model.parameters())
    moved = built(method, scene, "cpu", visible_only)
    moved.restore(there.state())
    if rasterizer_for("cuda").note is None:
        likeness = [psnr(ours, same) for ours, same in zip(pictures(moved, scene), pictures(there, scene), strict=True)]
        assert min(likeness) > ALIKE
    truths = [view.image(scene.background_color).permute(1, 2, 0) for view in scene.test]
    scores = [
        sum(psnr(image, truth) for image, truth in zip(pictures(training, scene), truths, strict=True)) / len(truths)
        for training in (there, here)
    ]
    assert scores[0] > scores[1] - AS_GOOD
