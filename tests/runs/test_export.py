"""What leaves as a PLY shows what the model shows: opacity factors are folded into the opacity."""

import math
from collections.abc import Mapping

import pytest
import torch
from torch import nn

from ringlight.core.rendering import Emission
from ringlight.core.scene import PointCloud
from ringlight.errors import OutputError
from ringlight.files.formats.contract import Form
from ringlight.files.formats.table import WRITERS
from ringlight.files.ply import read_gaussian_ply
from ringlight.methods.store import StoredModel, model_header, scene_facts
from ringlight.methods.table import METHODS
from ringlight.models.contract import Count
from ringlight.models.initial import gaussians_from_points
from ringlight.models.splats import SplatModel
from ringlight.rasterize.choose import rasterizer_for
from ringlight.rasterize.reference import ReferenceRasterizer
from ringlight.runs.export import check_target, export
from ringlight.shade.passthrough import PassThrough
from small_recipes import small
from tiny_scene import tiny_scene

FACTORS = (0.0, 0.25, 0.5, 1.0)


class Dimmed(nn.Module):
    """Grey whose opacity is multiplied by a column, twice as strongly for cameras below the horizon."""

    emits: Mapping[str, int] = {"rgb": 3}
    training_columns: tuple[str, ...] = ()
    opacity_columns: tuple[str, ...] = ()
    axes_are_normals: bool = False

    def new_columns(self, points):
        return {"dim": torch.tensor(FACTORS).repeat(len(points.positions) // len(FACTORS))}

    def emit(self, gaussians, camera, names, want):
        share = 1.0 if camera.position[2] > 0 else 0.5
        return Emission(self.emits, torch.full((len(gaussians), 3), 0.5), share * gaussians.appearance["dim"])

    def layers(self, gaussians, camera):
        return {}

    def features(self, gaussians, camera):
        """None: it has no network."""

    def wanted(self, gaussians):
        return torch.ones(len(gaussians), dtype=torch.bool)

    def harmonics(self, gaussians):
        """None: greys are not kept as such."""


def test_opacity_factors_become_part_of_the_opacity(tmp_path):
    scene, color = tiny_scene(views=4, size=8), Dimmed()
    points = PointCloud(scene.points.positions[:40], scene.points.colors[:40])
    table = gaussians_from_points(points, color)
    model = SplatModel(table, color, PassThrough(), ReferenceRasterizer())
    cameras = tuple(view.camera for view in scene.train)
    assert sum(bool(camera.position[2] > 0) for camera in cameras) == 2
    header = model_header("3dgs", METHODS["3dgs"], 0, scene_facts(scene))

    exported = export(StoredModel(model, header, cameras, model.rasterize), tmp_path / "dimmed.ply", fit_steps=0)

    found = read_gaussian_ply(tmp_path / "dimmed.ply").gaussians
    shown = table.appearance["dim"] > 0
    assert exported.counted == len(found) == 30, "what is never shown is left out"
    torch.testing.assert_close(found.means, table.means[shown])
    expected = table.opacities[shown] * table.appearance["dim"][shown] * 0.75
    torch.testing.assert_close(found.opacities, expected)
    assert exported.loss is not None
    assert exported.loss.rmse < 1e-3
    assert not math.isnan(exported.loss.psnr)


class Listing:
    """A format of a test: names and shapes of what it gets."""

    about = "people"

    def __init__(self, form):
        self.form = form

    def write(self, path, content):
        path.write_text("\n".join(f"{name} {list(tensor.shape)}" for name, tensor in content.tensors.items()))


@pytest.fixture
def listing(monkeypatch):
    """Puts the format into the table, in any form."""

    def put(form):
        monkeypatch.setitem(WRITERS, ".txt", Listing(form))

    return put


def stored_model(method):
    scene = tiny_scene(views=3, size=12)
    model = small(method).build(scene, rasterizer_for("cpu"), 0).model
    header = model_header(method, METHODS[method], 0, scene_facts(scene))
    return StoredModel(model, header, tuple(view.camera for view in scene.train), model.rasterize)


class Voxels:
    """A model that is no table of Gaussians, as far as an export asks."""

    def splats(self):
        return None

    def solid(self):
        return None

    def rendering_size(self):
        return Count(8, "voxels"), 32

    def rendering_tensors(self):
        return {"density": torch.zeros(2, 2, 2)}


def voxels():
    stored = stored_model("3dgs")
    object.__setattr__(stored, "model", Voxels())
    return stored


def test_a_format_is_one_line_in_the_table(tmp_path, listing):
    with pytest.raises(OutputError, match=r"out\.txt: cannot be written: .*; end its name in \.ply$"):
        check_target(tmp_path / "out.txt", False)
    listing(Form.OWN)
    check_target(tmp_path / "out.txt", False)
    exported = export(stored_model("ringlight-mirror"), tmp_path / "out.txt")
    assert "shader.maps" in (tmp_path / "out.txt").read_text()
    assert (exported.noun, exported.loss) == ("Gaussians", None)


@pytest.mark.parametrize("form", [Form.HARMONICS, Form.EXACT_HARMONICS])
def test_harmonics_are_exact_where_the_model_has_them(form, tmp_path, listing):
    listing(form)
    assert export(stored_model("3dgs"), tmp_path / "out.txt").loss is None
    assert "sh_rest [400, 15, 3]" in (tmp_path / "out.txt").read_text()


def test_harmonics_under_a_shader_that_adds_light_are_not_exact(tmp_path, listing):
    """By their columns they would be, and every reflection would be lost."""
    listing(Form.EXACT_HARMONICS)
    stored = stored_model("3dgs")
    stored.model.splats().shader.adds_light = True
    with pytest.raises(OutputError, match="exact harmonics, and the colours of 3dgs are none"):
        export(stored, tmp_path / "out.txt")
    assert export(stored, tmp_path / "out.ply", fit_steps=0).loss is not None


@pytest.mark.parametrize("method", ["ringlight-ring", "ringlight-mirror"])
def test_what_a_model_does_not_have_is_refused_before_anything_is_written(method, tmp_path, listing):
    listing(Form.EXACT_HARMONICS)
    with pytest.raises(OutputError, match=rf"exact harmonics, and the colours of {method} are none; .*into \.ply"):
        export(stored_model(method), tmp_path / "out.txt")
    with pytest.raises(OutputError, match=r"out\.ply: cannot be written: it holds Gaussians, .* made of voxels; "):
        export(voxels(), tmp_path / "out.ply")
    assert list(tmp_path.iterdir()) == []


def test_a_model_of_anything_can_be_written_in_its_own_form(tmp_path, listing):
    listing(Form.OWN)
    exported = export(voxels(), tmp_path / "out.txt")
    assert (exported.counted, exported.noun) == (8, "voxels")
