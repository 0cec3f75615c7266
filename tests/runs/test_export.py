"""What leaves as a PLY shows what the model shows: opacity factors are folded into the opacity."""

import math
from collections.abc import Mapping

import torch
from torch import nn

from ringlight.core.rendering import Emission
from ringlight.core.scene import PointCloud
from ringlight.data.synthetic import tiny_scene
from ringlight.files.ply import read_gaussian_ply
from ringlight.methods.store import StoredModel, model_header, scene_facts
from ringlight.methods.table import METHODS
from ringlight.models.initial import gaussians_from_points
from ringlight.models.splats import SplatModel
from ringlight.rasterize.reference import ReferenceRasterizer
from ringlight.runs.export import export_ply
from ringlight.shade.passthrough import PassThrough

FACTORS = (0.0, 0.25, 0.5, 1.0)


class Dimmed(nn.Module):
    """Grey whose opacity is multiplied by a column, twice as strongly for cameras below the horizon."""

    emits: Mapping[str, int] = {"rgb": 3}
    training_columns: tuple[str, ...] = ()

    def new_columns(self, points):
        return {"dim": torch.tensor(FACTORS).repeat(len(points.positions) // len(FACTORS))}

    def emit(self, gaussians, camera, names, want):
        share = 1.0 if camera.position[2] > 0 else 0.5
        return Emission(self.emits, torch.full((len(gaussians), 3), 0.5), share * gaussians.appearance["dim"])

    def layers(self, gaussians, camera):
        return {}

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

    exported = export_ply(StoredModel(model, header, cameras), tmp_path / "dimmed.ply")

    found = read_gaussian_ply(tmp_path / "dimmed.ply").gaussians
    shown = table.appearance["dim"] > 0
    assert exported.n_gaussians == len(found) == 30, "what is never shown is left out"
    torch.testing.assert_close(found.means, table.means[shown])
    expected = table.opacities[shown] * table.appearance["dim"][shown] * 0.75
    torch.testing.assert_close(found.opacities, expected)
    assert exported.rmse is not None
    assert exported.rmse < 1e-3
    assert not math.isnan(exported.psnr)
