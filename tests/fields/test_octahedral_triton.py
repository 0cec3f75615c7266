"""The octahedral maps' Triton kernels against the reference, in value and gradient."""

import pytest
import torch

import interpreted
from ringlight.core.directions import octahedral_from_directions
from ringlight.fields.octahedral import OctahedralMaps
from ringlight.fields.octahedral_triton import maps_by_triton


@pytest.mark.parametrize(
    ("sides", "features", "count"), [((2,), 1, 5), ((4, 7), 3, 131), ((8, 3, 16), 4, 200)], ids=["least", "odd", "many"]
)
def test_equals_the_reference(sides: tuple[int, ...], features: int, count: int):
    generator = torch.Generator().manual_seed(count)
    maps = OctahedralMaps(sides, features, generator)
    directions = torch.nn.functional.normalize(torch.randn(count, 3, generator=generator), dim=-1)
    uv = octahedral_from_directions(directions)
    upstream = torch.randn(count, features * len(sides), generator=generator)

    exact = maps.double()
    truth_uv = uv.double().requires_grad_()
    expected = exact(truth_uv)
    expected.backward(upstream.double())
    ours_uv = uv.to(interpreted.DEVICE).requires_grad_()
    levels = [level.detach().float().to(interpreted.DEVICE).requires_grad_() for level in exact.levels]
    found = maps_by_triton(ours_uv, levels)
    found.backward(upstream.to(interpreted.DEVICE))
    # Close to a line between cells float32 may fall on its other side, where the slope is another.
    sure = torch.stack([((truth_uv + 1) * 0.5 * (side - 1)).frac().sub(0.5).abs() < 0.499 for side in sides]).all(0)
    pairs = [(found, expected), *((a.grad, b.grad) for a, b in zip(levels, exact.levels, strict=True))]
    pairs.append((ours_uv.grad.cpu()[sure], truth_uv.grad[sure]))
    for mine, truth in pairs:
        torch.testing.assert_close(mine.cpu().double(), truth, rtol=0, atol=2e-5 * truth.abs().max().item() + 1e-9)


def test_no_directions():
    levels = [torch.ones(4, 4, 2, device=interpreted.DEVICE).requires_grad_()]
    features = maps_by_triton(torch.zeros(0, 2, device=interpreted.DEVICE), levels)
    features.sum().backward()
    assert features.shape == (0, 2)
    assert (levels[0].grad == 0).all()
