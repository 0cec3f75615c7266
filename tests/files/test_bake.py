"""Baked harmonics show what the colour model showed where cameras looked, and stay tame where none did."""

import math
import sys

import pytest
import torch

from ringlight.core.camera import Camera
from ringlight.core.directions import normalize, view_directions
from ringlight.core.gaussians import Gaussians
from ringlight.core.sh_basis import GREY, sh_basis
from ringlight.files.bake import Baked, bake_to_sh
from ringlight.files.orbit import orbit_of


def gaussians(rows: int) -> Gaussians:
    means = torch.randn(rows, 3, generator=torch.Generator().manual_seed(5)) * 0.3
    normals = normalize(means)
    return Gaussians(means, torch.zeros(rows, 3), torch.ones(rows, 4), torch.zeros(rows), {"normals": normals})


def cameras(count: int, upper_only: bool = False) -> list[Camera]:
    """Spread over the sphere, or its upper half, by the golden angle, looking at the origin."""
    found = []
    for i in range(count):
        z = (1 - (i + 0.5) / count) if upper_only else (1 - 2 * (i + 0.5) / count)
        turn, around = i * math.pi * (3 - math.sqrt(5)), math.sqrt(1 - z * z)
        away = torch.tensor([around * math.cos(turn), around * math.sin(turn), z])
        right = normalize(torch.linalg.cross(-away, torch.tensor([0.1, 0.2, 1.0])))
        rotation = torch.stack([right, torch.linalg.cross(-away, right), -away])
        matrix = torch.eye(4)
        matrix[:3, :3], matrix[:3, 3] = rotation, torch.tensor([0.0, 0.0, 4.0])
        found.append(Camera(matrix, (100.0, 100.0), (50.0, 50.0), 100, 100))
    return found


def shown(baked: Baked, table: Gaussians, camera: Camera) -> torch.Tensor:
    basis = sh_basis(view_directions(table.means, camera.position), 3)
    coefficients = torch.cat([baked.sh_dc[:, None], baked.sh_rest], 1)
    return (torch.einsum("nk,nkc->nc", basis, coefficients) + GREY).clamp_min(0)


def glossy(table: Gaussians, camera: Camera) -> torch.Tensor:
    """A base colour and a highlight where the camera looks along the normal: no finite number of harmonics."""
    facing = -(view_directions(table.means, camera.position) * table.appearance["normals"]).sum(1, keepdim=True)
    base = 0.4 + 0.3 * table.appearance["normals"]
    return base * 0.7 + 0.3 * torch.exp(6 * (facing - 1))


def test_exact_harmonics_come_back() -> None:
    table = gaussians(50)
    true = torch.randn(50, 16, 3, generator=torch.Generator().manual_seed(1)) * 0.08

    def exact(part: Gaussians, camera: Camera) -> torch.Tensor:
        basis = sh_basis(view_directions(part.means, camera.position), 3)
        return torch.einsum("nk,nkc->nc", basis, true[: len(part)]) + GREY

    baked = bake_to_sh(table, cameras(100), exact)
    assert baked.rmse < 5e-4
    assert baked.psnr > 66
    torch.testing.assert_close(baked.sh_dc, true[:, 0], atol=2e-3, rtol=0)
    torch.testing.assert_close(baked.sh_rest, true[:, 1:], atol=4e-3, rtol=0)


def test_one_color_from_everywhere_needs_no_more_than_the_constant() -> None:
    table = gaussians(20)
    baked = bake_to_sh(table, cameras(30), lambda part, camera: part.appearance["normals"] * 0.5 + 0.5)
    assert baked.sh_rest.abs().max() < 1e-4
    assert baked.rmse < 1e-5


def test_the_error_is_that_of_the_picture() -> None:
    table = gaussians(200)
    views = cameras(80)
    baked = bake_to_sh(table, views, glossy)
    squares = torch.stack([(shown(baked, table, camera) - glossy(table, camera)) ** 2 for camera in views])
    assert baked.rmse == pytest.approx(squares.mean().sqrt().item(), rel=1e-3)
    assert baked.worst == pytest.approx(squares.mean((0, 2)).sqrt().max().item(), rel=1e-3)
    assert baked.psnr == pytest.approx(-20 * math.log10(baked.rmse))
    assert baked.psnr > 30


def test_new_views_are_about_as_good_as_the_given_ones() -> None:
    table = gaussians(200)
    baked = bake_to_sh(table, cameras(80), glossy)
    errors = [(shown(baked, table, camera) - glossy(table, camera)) ** 2 for camera in orbit_of(cameras(7)).cameras(20)]
    assert torch.stack(errors).mean().sqrt().item() < 1.5 * baked.rmse


def test_the_unseen_side_stays_tame() -> None:
    table = gaussians(200)
    baked = bake_to_sh(table, cameras(40, upper_only=True), glossy)
    assert baked.psnr > 35
    below = [shown(baked, table, camera) for camera in cameras(60) if camera.position[2] < -1]
    assert torch.stack(below).max() < 2.5


def test_fewer_cameras_than_coefficients_still_solve() -> None:
    baked = bake_to_sh(gaussians(10), cameras(1), glossy)
    assert baked.sh_rest.isfinite().all()
    assert baked.rmse < 0.01


def test_cameras_that_look_elsewhere_hardly_count() -> None:
    table = gaussians(30)
    views = cameras(60)
    blind = [Camera(c.world_to_camera, c.focal, (-500.0, 50.0), c.width, c.height) for c in views]

    def misled(part: Gaussians, camera: Camera) -> torch.Tensor:
        return glossy(part, camera) if camera.center[0] > 0 else torch.zeros(len(part), 3)

    assert bake_to_sh(table, views + blind, misled).rmse < bake_to_sh(table, views, glossy).rmse + 0.03


def test_what_no_camera_sees_is_no_error():
    table, views = gaussians(30), cameras(60, upper_only=True)
    above = Gaussians.from_columns({n: torch.cat([c, c]) for n, c in table.columns().items()})
    above.means[30:, 2] += 100

    def unfit(part: Gaussians, camera: Camera) -> torch.Tensor:
        # So far above, all cameras are in one direction: colours that differ between them fit no harmonics.
        return torch.where(part.means[:, 2:] > 50, float(camera.position[0] > 0), glossy(part, camera))

    seen, both = bake_to_sh(table, views, glossy), bake_to_sh(above, views, unfit)
    assert both.rmse == pytest.approx(seen.rmse, rel=1e-4)
    assert both.worst == pytest.approx(seen.worst, rel=1e-4)


def test_the_chunks_do_not_show(monkeypatch: pytest.MonkeyPatch) -> None:
    table = gaussians(64)
    whole = bake_to_sh(table, cameras(20), glossy)
    monkeypatch.setattr(sys.modules["ringlight.files.bake"], "CHUNK_FLOATS", 16 * 20 * 10)
    parts = bake_to_sh(table, cameras(20), glossy)
    torch.testing.assert_close(parts.sh_rest, whole.sh_rest, atol=1e-5, rtol=1e-5)
    assert parts.rmse == pytest.approx(whole.rmse, rel=1e-4)


def test_an_empty_model_and_no_camera() -> None:
    empty = bake_to_sh(gaussians(0), cameras(3), glossy)
    assert empty.sh_rest.shape == (0, 15, 3)
    assert empty.psnr == math.inf
    with pytest.raises(ValueError, match="at least one camera"):
        bake_to_sh(gaussians(3), [], glossy)
