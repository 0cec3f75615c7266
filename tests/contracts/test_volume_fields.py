"""What every field of a volume must do, parametrised over ringlight's and the plug."""

import math
from collections.abc import Callable

import pytest
import torch
from torch import Tensor, nn

from contracts.differences import TOLERANCE, slopes_differ
from plugs.dense_field import FEATURES, DenseField
from ringlight.core.want import Want
from ringlight.data.rays import RayBatch
from ringlight.volume import model as of_model
from ringlight.volume.contract import Sides, VolumeField
from ringlight.volume.factored import FactoredField
from ringlight.volume.model import VolumeModel
from ringlight.volume.shading import FeatureShading
from ringlight.volume.tensor_train_field import TensorTrainField
from volume.volumes import BACKGROUND, BOX, rays

SIDES: Sides = (8, 8, 8)


def drawn() -> torch.Generator:
    return torch.Generator().manual_seed(1)


KINDS: dict[str, Callable[[], nn.Module]] = {
    "planes times lines": lambda: FactoredField("vm", SIDES, (16, 16), FEATURES, drawn()),
    "lines": lambda: FactoredField("cp", SIDES, (16, 16), FEATURES, drawn()),
    "tensor trains": lambda: TensorTrainField(3, 5, (64, 64), FEATURES, drawn()),
    "tensor trains, one long axis": lambda: TensorTrainField(4, 6, (64, 64), FEATURES, drawn(), (1,)),
    "tensor trains, two long axes": lambda: TensorTrainField(4, 6, (120, 120), FEATURES, drawn(), (0, 2)),
    "plug: dense": lambda: DenseField(SIDES, drawn()),
}

pytestmark = [pytest.mark.parametrize("kind", KINDS)]


def field_of(kind: str, dtype: torch.dtype = torch.float32) -> nn.Module:
    return KINDS[kind]().to(dtype)


def places(count: int = 60, dtype: torch.dtype = torch.float32) -> Tensor:
    return torch.rand(count, 3, generator=drawn(), dtype=torch.float64).to(dtype)


def all_of(field: VolumeField, points: Tensor) -> Tensor:
    return torch.cat([field.density(points)[:, None], field.appearance(points)], 1)


def nodes_of(field: VolumeField) -> Tensor:
    axes = [torch.arange(n) / count for n, count in zip(field.sides, field.intervals, strict=True)]
    return torch.stack(torch.meshgrid(*axes, indexing="ij"), -1).view(-1, 3).double()


def test_it_says_density_and_features_of_any_place_in_the_box(kind: str):
    field = field_of(kind)
    assert isinstance(field, VolumeField)
    corners = torch.tensor([[0.0, 0.0, 0.0], [1.0, 1.0, 1.0], [1.0, 0.0, 0.5]])
    found = all_of(field, torch.cat([places(), corners]))
    assert found.shape == (63, 1 + FEATURES)
    assert found.isfinite().all()
    assert all_of(field, torch.zeros(0, 3)).shape == (0, 1 + FEATURES)


def test_between_the_nodes_that_it_names_it_runs_straight(kind: str):
    field = field_of(kind, torch.float64)
    steps = 1 / torch.tensor(field.intervals)
    first = nodes_of(field).view(*field.sides, 3)[:-1, :-1, :-1].reshape(-1, 3)
    for axis in range(3):
        step = torch.zeros(3, dtype=torch.float64)
        step[axis] = steps[axis]
        quarter, half, whole = (all_of(field, (first + share * step).clamp(0, 1)) for share in (0.25, 0.5, 1.0))
        start = all_of(field, first)
        torch.testing.assert_close(half, (start + whole) / 2, atol=1e-6, rtol=1e-6)
        torch.testing.assert_close(quarter, 0.75 * start + 0.25 * whole, atol=1e-6, rtol=1e-6)


def test_gradients_agree_with_finite_differences(kind: str):
    field, points = field_of(kind, torch.float64), places(20, torch.float64)
    weights = torch.randn(20, 1 + FEATURES, generator=drawn(), dtype=torch.float64)

    def value() -> Tensor:
        return (all_of(field, points) * weights).sum()

    parameters = dict(field.named_parameters())
    trains = kind.startswith("tensor trains")
    used = {name: p for name, p in parameters.items() if not (trains and p.shape == (1, 8, 1))}
    found = dict(zip(used, torch.autograd.grad(value(), list(used.values())), strict=True))
    assert all(gap < TOLERANCE for gap in slopes_differ(value, used, found).values())


def test_its_outline_has_the_shapes_of_the_field_itself(kind: str):
    field = field_of(kind)
    for voxels in (8.0**3, 16.0**3):
        field.resize(field.fitting(BOX, voxels))
        with torch.device("meta"):
            outline = {name: tensor.shape for name, tensor in field.outline(field.sides).items()}
        assert outline == {name: tensor.shape for name, tensor in field.named_parameters()}


def test_a_finer_one_shows_the_same(kind: str):
    field = field_of(kind)
    before = all_of(field, places())
    coarse, finer = field.sides, field.fitting(BOX, 8.0 * math.prod(field.sides))
    assert all(2 * a - 4 <= b <= 2 * a + 4 for a, b in zip(coarse, finer, strict=True))
    nested: Sides = finer if kind.startswith("tensor trains") else (15, 15, 15)  # whose nodes include the old ones
    field.resize(nested)
    assert field.sides == nested
    torch.testing.assert_close(all_of(field, places()), before, atol=2e-3, rtol=1e-3)


def test_its_part_shows_what_is_there(kind: str):
    field = field_of(kind)
    asked: tuple[Sides, Sides] = ((1, 2, 0), (5, 6, 7))
    first, last = field.cuttable(*asked)
    assert all(a <= b for a, b in zip(first, asked[0], strict=True))
    assert all(a >= b for a, b in zip(last, asked[1], strict=True))
    if (first, last) == ((0, 0, 0), tuple(side - 1 for side in field.sides)):
        return  # it cannot be cut
    before, points = field.intervals, places()
    low, high = (torch.tensor(ends) / torch.tensor(before) for ends in (first, last))
    wanted = all_of(field, low + points * (high - low))
    field.crop(first, last)
    assert field.sides == tuple(b - a + 1 for a, b in zip(first, last, strict=True))
    torch.testing.assert_close(all_of(field, points), wanted, atol=1e-5, rtol=1e-5)


def test_rays_through_it_by_kernels_are_those_of_the_reference(kind: str, monkeypatch: pytest.MonkeyPatch):
    field = field_of(kind)
    model = VolumeModel(field, FeatureShading(FEATURES, 16, drawn()), BOX)
    monkeypatch.setattr(of_model, "SHIFT", -1.0)  # so that rays end in it
    batch = RayBatch(rays(80), torch.zeros(80, 3), BACKGROUND)
    shown = [model.predict(batch, Want.GRADIENTS)]
    with monkeypatch.context() as patch:
        patch.setattr(of_model, "runs_native", lambda *_: False)
        shown.append(model.predict(batch, Want.GRADIENTS))
    ours, reference = shown
    assert 0.1 < reference.alpha.mean() < 0.9
    torch.testing.assert_close(ours.alpha, reference.alpha, atol=5e-3, rtol=0)
    torch.testing.assert_close(ours.color, reference.color, atol=1e-2, rtol=0)
    upstream = torch.randn(80, 3, generator=drawn())
    one, other = (dict(each.backward(upstream, {})) for each in shown)
    not_reached = {name for name, p in model.named_parameters() if name.startswith("field") and p.shape == (1, 8, 1)}
    assert one.keys() == other.keys() == {name for name, _ in model.named_parameters()} - not_reached
    for name, gradient in other.items():
        assert (one[name] - gradient).norm() <= 0.1 * gradient.norm() + 1e-6, name
