"""Everything that a GPU would run, without one: a step of every recipe on a device that is not the CPU.

There torch operations take the place of native kernels, as on a GPU without Triton, and gsplat's torch functions that
of its kernels; what mixes devices, or reads numbers natively, fails.
"""

import dataclasses
from itertools import product
from pathlib import Path

import pytest
import torch

from gsplat_torch import TorchGsplat
from other_device import ELSEWHERE, other_device
from ringlight.core.scene import Scene
from ringlight.data import hull
from ringlight.data.batches import ImageBatch
from ringlight.fit.strategies.densify_settings import DensifySettings
from ringlight.fit.train import Training, train
from ringlight.measure.metrics import psnr
from ringlight.methods.store import load_model, model_header, save_model, scene_facts
from ringlight.methods.table import METHODS
from ringlight.models.splats import SplatModel
from ringlight.rasterize.choose import rasterizer_for
from ringlight.rasterize.contract import Rasterizer
from ringlight.rasterize.cuda import CudaRasterizer
from ringlight.rasterize.gsplat_seam import TILE, Ellipses, Gsplat, tile_counts
from small_recipes import COARSE, TRAINED, with_settings
from tiny_scene import tiny_scene

STEPS = 12

ALIKE = 60
"""dB between renderings: the acceptance of both back ends, a quarter of an 8-bit step."""


class GsplatElsewhere(Gsplat):
    """Takes tensors of the other device and gives such; in between gsplat's torch functions work on the CPU."""

    def project(self, *columns, **named) -> Ellipses:
        *tensors, size, options = columns
        seen = super().project(*(tensor.cpu() for tensor in tensors), size, options)
        return _moved(seen, ELSEWHERE)

    def tiles(self, seen: Ellipses, size: tuple[int, int]):
        """The same lists as gsplat's, tile by tile; its torch function walks over every pair in Python."""
        here = _moved(seen, torch.device("cpu"))
        low, high = (here.means2d - here.radii) / TILE, (here.means2d + here.radii) / TILE
        nearest = here.depths.argsort(stable=True)
        across, down = tile_counts(size)
        lists = []
        for y, x in product(range(down), range(across)):
            corner = torch.tensor([x, y])
            touches = ((low < corner + 1) & (high > corner)).all(1)
            lists.append(nearest[touches[nearest]])
        lengths = torch.tensor([len(each) for each in lists])
        offsets = (lengths.cumsum(0) - lengths).view(1, down, across).int()
        return offsets.to(ELSEWHERE), torch.cat(lists).int().to(ELSEWHERE)

    def blend(self, seen: Ellipses, channels, opacities, size, lists, absgrad: bool):
        here, lists = _moved(seen, torch.device("cpu")), tuple(tensor.cpu() for tensor in lists)
        image, alpha = super().blend(here, channels.cpu(), opacities.cpu(), size, lists, absgrad)
        return image.to(ELSEWHERE), alpha.to(ELSEWHERE)


def _moved(seen: Ellipses, device: torch.device) -> Ellipses:
    fields = {field.name: getattr(seen, field.name) for field in dataclasses.fields(seen)}
    return Ellipses(**{name: None if value is None else value.to(device) for name, value in fields.items()})


def rasterizer_elsewhere() -> CudaRasterizer:
    return CudaRasterizer(GsplatElsewhere(TorchGsplat()), ELSEWHERE)


CHANGED = DensifySettings(threshold=1e-5, begin=4, every=5, stop=1.0, reset_every=7)
KEPT, KEEPING = DensifySettings(begin=0, stop=0.0, latest=0, reset_every=0), {"gaussian-shader"}
"""No density control: a Gaussian a pixel, the bound, is reached at once, and the last bit says which are copied."""


def short_run(method: str, scene: Scene, rasterize: Rasterizer, dropout: float = 0.0) -> Training:
    """Twelve steps with everything in them: density control, the light field switched on. Whole gradients, no dropout
    but where nothing grows, and light-gaussian drops by significance: which rows are importance-sampled, which place a
    grown row takes, and whose removal changes least, depends on a sum's last bit."""
    whole = {"gradient_share": 1.0}
    settings = COARSE | {
        "steps": STEPS,
        "densify": KEPT if dropout or method in KEEPING else CHANGED,
        "light": {"ring": {"position_nodes": 32, "view_nodes": 8}} | whole,
        "shader": whole,
        "dropout": dropout,
        "prune_by": "significance",
        **whole,
    }
    return with_settings(METHODS[method], settings).build(scene, rasterize, seed=0)


@pytest.mark.parametrize("method", TRAINED)
def test_a_file_is_shown_elsewhere(method: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setattr(hull, "FINE_CELLS", 24)
    scene = tiny_scene(views=6, size=24)
    model = short_run(method, scene, rasterizer_for("cpu")).model
    recipe, file = with_settings(METHODS[method], COARSE), tmp_path / "model.safetensors"
    header = model_header(method, recipe, 0, scene_facts(scene))
    save_model(file, model, header, [view.camera for view in scene.train])
    with other_device():
        there = load_model(file, rasterizer_elsewhere()).model
        assert {parameter.device.type for parameter in there.parameters()} == {ELSEWHERE.type}
        shown = pictures(there, scene)
    for elsewhere, here in zip(shown, pictures(model, scene), strict=True):
        assert psnr(elsewhere, here) > ALIKE


LOSSES_ALIKE = {
    "3dgs-dr": {"rel": 0.05},
    "gaussian-shader": {"rel": 0.1},
    "light-gaussian": {"rel": 3e-3, "abs": 1e-5},
    "putt": {"rel": 0.02},
}
"""Which axis of a Gaussian is its normal, the last bit says of those of gaussian-shader, which are round here at first.
Strengths of 3dgs-dr that hardly have a gradient are moved by their whole rate to where its last bit points. What a
distilled model differs by from its teacher is some 1e-5; Gaussians are split along axes that are round at first, and of
those about as significant the last bit says which are dropped. Where a doubled train of putt has room to spare, it says
along which of equal singular vectors it goes on."""

PICTURES_ALIKE = {"3dgs-dr": 40, "gaussian-shader": 20, "light-gaussian": 50, "putt": 30}
"""dB, for the same reasons."""


def pictures(model: SplatModel, scene: Scene) -> list[torch.Tensor]:
    with torch.no_grad():
        return [model.render(view.camera, scene.background_color).color.cpu() for view in scene.test]


@pytest.mark.parametrize("method", TRAINED)
def test_training_elsewhere_is_training_here(method: str, monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setattr(hull, "FINE_CELLS", 24)
    scene = tiny_scene(views=6, size=24)
    here = short_run(method, scene, rasterizer_for("cpu"))
    losses = [progress.loss for progress in train(here)]
    with other_device():
        there = short_run(method, scene, rasterizer_elsewhere())
        assert {parameter.device.type for parameter in there.model.parameters()} == {ELSEWHERE.type}
        alike = LOSSES_ALIKE.get(method, {"rel": 1e-3})
        assert [progress.loss for progress in train(there)] == pytest.approx(losses, **alike)
        assert there.model.counted() == here.model.counted()
        shown = pictures(there.model, scene)
        parts = {name: layer.cpu() for name, layer in there.model.layers(scene.test[0].camera).items()}
        moved = short_run(method, scene, rasterizer_for("cpu"))
        moved.restore(there.state())
    assert parts.keys() == moved.model.layers(scene.test[0].camera).keys()
    assert parts["depth"].isfinite().all()
    for ours, native, again in zip(shown, pictures(here.model, scene), pictures(moved.model, scene), strict=True):
        assert psnr(ours, native) > PICTURES_ALIKE.get(method, ALIKE)
        assert psnr(ours, again) > ALIKE, "the same model on the other device"


@pytest.mark.parametrize("method", ["3dgs", "glossy-gaussian", "ringlight-basis"])
def test_the_same_gaussians_are_left_out_elsewhere(method: str, monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setattr(hull, "FINE_CELLS", 24)
    scene = tiny_scene(views=6, size=24)
    here = short_run(method, scene, rasterizer_for("cpu"), 0.2)
    last = here.batches.at(STEPS)
    assert isinstance(last, ImageBatch)
    assert last.left_out is not None
    losses = [progress.loss for progress in train(here)]
    with other_device():
        there = short_run(method, scene, rasterizer_elsewhere(), 0.2)
        assert [progress.loss for progress in train(there)] == pytest.approx(losses, rel=1e-3)
