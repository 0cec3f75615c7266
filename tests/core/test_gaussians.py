"""The table of Gaussians: columns round-trip, rotations are rotations."""

import torch

from ringlight.core.gaussians import Gaussians


def random_gaussians(count: int = 7) -> Gaussians:
    generator = torch.Generator().manual_seed(0)
    draw = lambda *shape: torch.randn(*shape, generator=generator)  # noqa: E731
    return Gaussians(draw(count, 3), draw(count, 3), draw(count, 4), draw(count), {"base": draw(count, 3)})


def test_columns_round_trip():
    table = random_gaussians()
    again = Gaussians.from_columns(table.columns())
    assert list(again.columns()) == ["means", "log_scales", "quats", "opacity_logits", "base"]
    assert all(torch.equal(a, b) for a, b in zip(table.columns().values(), again.columns().values(), strict=True))


def test_rows_follow_the_index_in_every_column():
    table = random_gaussians()
    chosen = table.rows(torch.tensor([4, 1]))
    assert torch.equal(chosen.means, table.means[[4, 1]])
    assert torch.equal(chosen.appearance["base"], table.appearance["base"][[4, 1]])


def test_rotations_are_orthonormal_for_quaternions_of_any_length():
    rotations = random_gaussians().rotations
    assert torch.allclose(rotations @ rotations.mT, torch.eye(3).expand(7, 3, 3), atol=1e-5)
    assert torch.allclose(torch.linalg.det(rotations), torch.ones(7), atol=1e-5)
