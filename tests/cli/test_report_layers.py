"""Layers of all runs that stand side by side are seen from one camera, of the first run that has any."""

import shutil
from pathlib import Path

import pytest
import torch

from ringlight.core.camera import Camera
from ringlight.pages.report import layers as module
from ringlight.pages.report.gathered import gathered
from ringlight.pages.report.groups import grouped
from ringlight.pages.report.layers import layer_names, layers_shown
from ringlight.runs.opened import open_model


@pytest.fixture
def seen_from(monkeypatch: pytest.MonkeyPatch) -> list[Camera]:
    """Every camera from which a model is looked at."""
    cameras: list[Camera] = []
    looking = module.looking

    def recorded(*words: object):
        look = looking(*words)

        def noted(camera: Camera):
            cameras.append(camera)
            return look(camera)

        return noted

    monkeypatch.setattr(module, "looking", recorded)
    return cameras


def test_the_middle_camera_of_the_first_run_that_opens_is_everybodys(
    trained: dict[str, Path], tmp_path: Path, seen_from: list[Camera]
) -> None:
    damaged = Path(shutil.copytree(trained["3dgs"], tmp_path / "damaged"))
    model = damaged / "model.safetensors"
    model.write_bytes(model.read_bytes()[:-50])
    (group,) = grouped([gathered(run) for run in (damaged, trained["3dgs"], trained["ringlight-ring"])])
    shown, troubles = layers_shown(group)
    cameras = open_model(trained["3dgs"]).stored.cameras
    assert [one.member.run.folder for one in shown] == [trained["3dgs"], trained["ringlight-ring"]]
    assert len(troubles) == 1
    assert str(model) in troubles[0]
    assert len(seen_from) >= 2
    for camera in seen_from:
        assert torch.equal(camera.world_to_camera, cameras[len(cameras) // 2].world_to_camera)
        assert (camera.width, camera.height, camera.focal) == (
            cameras[len(cameras) // 2].width,
            cameras[len(cameras) // 2].height,
            cameras[len(cameras) // 2].focal,
        )
    assert {(one.camera, one.of) for one in shown} == {(len(cameras) // 2, len(cameras))}
    assert layer_names(shown) == ["color", "base", "residual", "modulation", "normal", "depth"]
    assert "modulation" not in shown[0].pictures


def test_a_large_camera_is_shrunk_to_what_the_page_shows() -> None:
    large = Camera(torch.eye(4), (2000.0, 2000.0), (1000.0, 500.0), 2000, 1000)
    small = module._small(large)
    assert (small.width, small.height) == (800, 400)
    assert small.focal == (800.0, 800.0)
    assert module._small(small) == small
