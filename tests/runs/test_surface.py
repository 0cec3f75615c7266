"""The surface of a volume: where its density passes a level, with normals outwards, as other programs read it."""

import sys
from pathlib import Path

import numpy as np
import pytest
import torch
import trimesh

from ringlight.errors import BackendError, OutputError
from ringlight.methods.store import StoredModel, model_header, scene_facts
from ringlight.methods.table import METHODS
from ringlight.rasterize.choose import rasterizer_for
from ringlight.runs import surface
from ringlight.runs.export import export, export_surface
from ringlight.runs.surface import surface_of
from small_recipes import small
from tiny_scene import tiny_scene

pytest.importorskip("skimage")

MIDDLE, RADIUS = torch.tensor([0.2, -0.1, 0.0]), 0.6


class Ball:
    """Dense within a sphere of this middle and radius; red on its upper half."""

    box = torch.tensor([[-1.0, -1.0, -1.2], [1.2, 1.0, 1.0]])
    nodes, intervals = (40, 36, 44), (39, 35, 43)
    surface_density = 1.0

    def _world(self, places: torch.Tensor) -> torch.Tensor:
        return self.box[0] + places * (self.box[1] - self.box[0])

    def density_values(self, places: torch.Tensor) -> torch.Tensor:
        return RADIUS / (self._world(places) - MIDDLE).norm(dim=-1).clamp_min(1e-3)

    def color(self, places: torch.Tensor, directions: torch.Tensor) -> torch.Tensor:
        up = self._world(places)[:, 2:] > 0
        return torch.where(up, torch.tensor([1.0, 0.0, 0.0]), -directions.clamp(-1, 0))


def test_it_lies_where_density_passes_the_level_and_faces_outwards():
    found = surface_of(Ball(), "ball.ply")
    outward = found.corners - MIDDLE
    distances = outward.norm(dim=-1)
    assert (distances - RADIUS).abs().max() < 0.005
    assert ((outward / distances[:, None]) * found.normals).sum(-1).min() > 0.98
    a, b, c = (found.corners[found.triangles[:, k]] for k in range(3))
    normals = torch.linalg.cross(b - a, c - a)
    assert ((normals * (a - MIDDLE)).sum(-1) > 0).float().mean() > 0.999
    assert torch.equal(found.colors[found.corners[:, 2] > 0][0], torch.tensor([1.0, 0.0, 0.0]))


def test_a_node_that_is_not_at_the_end_of_the_box_is_where_it_says():
    """As of tensor trains, whose last node stands one before the end."""

    class Train(Ball):
        intervals = Ball.nodes

    found = surface_of(Train(), "ball.ply")
    assert ((found.corners - MIDDLE).norm(dim=-1) - RADIUS).abs().max() < 0.005


def test_what_memory_cannot_hold_is_refused_before_it_is_asked_for(monkeypatch: pytest.MonkeyPatch):
    class Fine(Ball):
        nodes = intervals = (1 << 12, 1 << 12, 1 << 12)

    with pytest.raises(OutputError, match="density at 4096 x 4096 x 4096 nodes takes 274,878 MB") as caught:
        surface_of(Fine(), "ball.ply")
    assert "ball.ply" in str(caught.value)
    monkeypatch.setattr(surface, "machine_memory", lambda: 8 * 40 * 36 * 44)
    surface_of(Ball(), "ball.ply")
    monkeypatch.setattr(surface, "machine_memory", lambda: 8 * 40 * 36 * 44 - 8)
    with pytest.raises(OutputError, match="coarser grid"):
        surface_of(Ball(), "ball.ply")


def stored(method: str) -> StoredModel:
    scene = tiny_scene(views=3, size=12)
    model = small(method).build(scene, rasterizer_for("cpu"), 0).model
    header = model_header(method, METHODS[method], 0, scene_facts(scene))
    return StoredModel(model, header, tuple(view.camera for view in scene.train), rasterizer_for("cpu"))


def as_ball(model: StoredModel, monkeypatch: pytest.MonkeyPatch) -> StoredModel:
    monkeypatch.setattr(model.model, "solid", Ball, raising=True)
    return model


@pytest.mark.parametrize("with_triangles", [True, False])
def test_other_programs_read_it(with_triangles: bool, tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    path = tmp_path / "ball.ply"
    written = export_surface(as_ball(stored("putt"), monkeypatch), path, with_triangles)
    read = trimesh.load(path, process=False)
    found = surface_of(Ball(), "")
    np.testing.assert_array_equal(read.vertices.astype(np.float32), found.corners.numpy())
    if with_triangles:
        assert (written.noun, written.counted) == ("triangles", len(read.faces))
        assert read.is_watertight
        assert read.volume == pytest.approx(4 / 3 * np.pi * RADIUS**3, rel=0.02)
        assert (read.visual.vertex_colors[:, 0] == 255).mean() > 0.3
    else:
        assert (written.noun, written.counted) == ("points", len(read.vertices))


@pytest.mark.parametrize("method", ["tensorf", "putt"])
def test_a_volume_without_a_surface_says_so(method: str, tmp_path: Path):
    model = stored(method)
    assert model.model.surface_density > 0
    with pytest.raises(OutputError, match="nowhere dense enough for a surface; train longer"):
        export_surface(model, tmp_path / "a.ply", with_triangles=True)
    with pytest.raises(OutputError, match="holds Gaussians, and this model is made of voxels; --mesh and --points"):
        export(model, tmp_path / "a.ply")
    assert not (tmp_path / "a.ply").exists()


def test_without_the_extra_it_is_named(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setitem(sys.modules, "skimage", None)
    with pytest.raises(BackendError, match=r"surfaces need the mesh extra: pip install .ringlight\[mesh\]"):
        export_surface(stored("putt"), tmp_path / "a.ply", with_triangles=True)


def test_gaussians_have_no_surface(tmp_path: Path):
    with pytest.raises(OutputError, match="made of Gaussians; export without --mesh and --points"):
        export_surface(stored("3dgs"), tmp_path / "a.ply", with_triangles=True)


def test_half_of_the_light_is_lost_between_nodes_of_that_density():
    model = stored("putt").model
    space = model.space()
    lengths = (model.box[1] - model.box[0]) / torch.tensor(model.intervals)
    left = torch.exp(-torch.tensor(model.surface_density) * space.optical / space.step * lengths.mean())
    assert left.item() == pytest.approx(0.5, rel=1e-4)
