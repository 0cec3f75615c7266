"""The active form by Triton's kernel against the reference, in value and gradient."""

import pytest
import torch

import interpreted
from contracts.raster_cases import random_case
from ringlight.core.gaussians import Gaussians
from ringlight.rasterize import stored_form
from ringlight.rasterize.stored_form_triton import activated_by_triton


@pytest.mark.parametrize("with_factor", [False, True])
@pytest.mark.filterwarnings("ignore:overflow", "ignore:invalid value")
def test_equals_the_reference(with_factor: bool):
    case = random_case(3, count=700, with_factor=True)
    table, near = case.gaussians, case.options.near
    table.log_scales[5, 1], table.means[6, 0], table.means[7] = 200.0, 1e30, 3e38
    table.quats[8] = 0.0
    columns = {name: column.requires_grad_() for name, column in table.columns().items()}
    factor = case.opacity_factor.requires_grad_() if with_factor else None
    expected = stored_form.active_form_reference(Gaussians.from_columns(columns), case.camera, near, factor)
    upstream = [torch.randn_like(column) for column in expected]
    torch.autograd.backward(expected, upstream)

    ours = {name: column.detach().to(interpreted.DEVICE).requires_grad_() for name, column in columns.items()}
    our_factor = factor.detach().to(interpreted.DEVICE).requires_grad_() if with_factor else None
    bounds = (near, stored_form.log_reach(case.camera), stored_form.FARTHEST, stored_form.SHORTEST_QUAT_SQUARED)
    plane = case.camera.world_to_camera[2].to(interpreted.DEVICE)
    found = activated_by_triton(*ours.values(), our_factor, plane, bounds)
    torch.autograd.backward(found, [gradient.to(interpreted.DEVICE) for gradient in upstream])
    assert (expected[2] == 0).sum() >= 3, "three rows cannot be projected"
    pairs = list(zip(found, expected, strict=True))
    pairs += [(ours[name].grad, columns[name].grad) for name in ("log_scales", "quats", "opacity_logits")]
    if with_factor:
        pairs.append((our_factor.grad, factor.grad))
    for mine, truth in pairs:
        torch.testing.assert_close(mine.cpu(), truth, rtol=1e-5, atol=1e-6)
