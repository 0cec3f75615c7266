"""What every light field must do, parametrised over all that are plugged in."""

from functools import partial

import pytest
import torch
from torch import Tensor, nn

from contracts.differences import TOLERANCE, slopes_differ
from contracts.plugged import FIELD_NAMES, LIGHT
from in_bfloat16 import IN_BFLOAT16
from ringlight.color.light_fields import FIELDS
from ringlight.core.directions import normalize
from ringlight.core.want import Want
from ringlight.fields.contract import LightField
from ringlight.fields.ring_tables import RingTables, tabulated_features

ROUNDING = 0.1 if IN_BFLOAT16 else 1e-4
"""Of the largest gradient: kernels in float32 against torch in float64."""

pytestmark = [pytest.mark.parametrize("name", FIELD_NAMES)]


def field_of(name: str, dtype: torch.dtype = torch.float32) -> nn.Module:
    return FIELDS[name](LIGHT, torch.Generator().manual_seed(1)).to(dtype)


def places(dtype: torch.dtype, count: int = 30) -> tuple[Tensor, Tensor]:
    drawn = torch.Generator().manual_seed(2)
    points = torch.rand(count, 3, generator=drawn, dtype=torch.float64) * 2 - 1
    directions = normalize(torch.randn(count, 3, generator=drawn, dtype=torch.float64))
    return points.to(dtype), directions.to(dtype)


def test_features_are_finite_and_as_many_as_asked_for(name: str):
    field = field_of(name)
    assert isinstance(field, LightField)
    for features in (field.exact(*places(torch.float32)), tabulated_features(field, *places(torch.float32))):
        assert features.shape == (30, LIGHT.ring.features)
        assert features.isfinite().all()


def test_tables_made_before_are_tables_made_now(name: str):
    field = field_of(name)
    with torch.no_grad():
        tables = field.tables(Want.EXACT)
        fresh = tabulated_features(field, *places(torch.float32))
        kept = tabulated_features(field, *places(torch.float32), tables)
    torch.testing.assert_close(kept, fresh, rtol=0, atol=1e-3 if IN_BFLOAT16 else 1e-6)


def test_features_of_torch_agree_with_finite_differences(name: str):
    field, (points, directions) = field_of(name, torch.float64), places(torch.float64)
    weights = torch.randn(30, LIGHT.ring.features, generator=torch.Generator().manual_seed(3), dtype=torch.float64)
    for features in (field.exact, partial(tabulated_features, field)):
        total = (features(points, directions) * weights).sum()
        parameters = dict(field.named_parameters())
        found = dict(zip(parameters, torch.autograd.grad(total, list(parameters.values())), strict=True))

        def value(features=features) -> Tensor:
            return (features(points, directions) * weights).sum()

        differs = slopes_differ(value, parameters, found)
        assert max(differs.values()) < TOLERANCE, differs


@pytest.mark.parametrize("dtype", [torch.float32, torch.float64])
def test_the_tables_way_back_is_torchs(name: str, dtype: torch.dtype):
    field = field_of(name, dtype)
    tables = field.tables(Want.GRADIENTS)
    if tables is None:
        assert field.tables(Want.EXACT) is None
        return
    drawn = torch.Generator().manual_seed(4)

    def noise(like: Tensor) -> Tensor:
        return torch.randn(like.shape, generator=drawn, dtype=torch.float64).to(like)

    grads = RingTables(noise(tables.axes), noise(tables.view), noise(tables.core), tables.diagonal)
    found = tables.backward(grads)
    exact = field_of(name, torch.float64)
    parameters = dict(exact.named_parameters())
    leaf = {n: p.detach().clone() for n, p in parameters.items()}

    def value() -> Tensor:
        made = exact.tables(Want.EXACT)
        pairs = ((made.axes, grads.axes), (made.view, grads.view), (made.core, grads.core))
        return sum((table * gradient.double()).sum() for table, gradient in pairs)

    assert found.keys() == parameters.keys()
    tolerance = TOLERANCE if dtype == torch.float64 else ROUNDING
    differs = slopes_differ(value, parameters, {n: gradient.double() for n, gradient in found.items()})
    assert max(differs.values()) < tolerance, differs
    assert all(torch.equal(parameters[n], tensor) for n, tensor in leaf.items())
    with pytest.raises(RuntimeError, match="no way back"):
        field.tables(Want.EXACT).backward(grads)


def test_its_state_is_all_of_it(name: str):
    field, again = field_of(name), FIELDS[name](LIGHT, torch.Generator())
    again.load_state_dict(field.state_dict())
    assert torch.equal(again.exact(*places(torch.float32)), field.exact(*places(torch.float32)))
