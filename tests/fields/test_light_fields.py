"""Every light field: its value against a formula written out, its gradients, its start, its tables."""

from collections.abc import Callable
from dataclasses import replace

import pytest
import torch
from torch import nn

from finite_differences import assert_gradients
from in_bfloat16 import IN_BFLOAT16, NEAR_KINKS
from ringlight.color.light_fields import FIELDS
from ringlight.color.ringlight_settings import RingLightSettings
from ringlight.core.directions import normalize, octahedral_from_directions
from ringlight.core.want import Want
from ringlight.errors import RecipeError
from ringlight.fields.contract import LightField
from ringlight.fields.encoding import FourierCode, fourier_features
from ringlight.fields.perceptron_field import PerceptronField, matched_width, ring_size
from ringlight.fields.ring_settings import KnotSettings, PerceptronSettings, RingSettings, VectorMatrixSettings
from ringlight.fields.ring_tables import RingTables, tabulated_features
from ringlight.fields.tables import axis_nodes, octahedral_nodes
from ringlight.fields.tensor_ring import TensorRing

CODE = FourierCode(2)
RING = RingSettings(rank=3, features=5, head_hidden=8, bands=2, view_bands=2, position_nodes=6, view_nodes=4)
SMALL = RingLightSettings(
    ring=RING,
    knots=KnotSettings(5, 4),
    vm=VectorMatrixSettings(side=4, components=2, view=3),
    mlp=PerceptronSettings(hidden=7),
)
NETWORK = replace(RING, core="network")
"""The channel core is a head too, as in definition 5 of the paper."""
CASES = {
    **{kind: (kind, SMALL) for kind in FIELDS},
    **{f"{kind} of heads alone": (kind, replace(SMALL, ring=NETWORK)) for kind in ("ring", "cp", "tt")},
    "ring without identity": ("ring", replace(SMALL, ring=replace(RING, code_identity=False, code_pi=False))),
}
"""Every field, and those that settings change."""
NEURAL = ("ring", "cp", "tt")
"""Fields whose heads are networks, so that exact and tabulated evaluation differ."""


def field_of(case: str, seed: int = 0) -> nn.Module:
    kind, light = CASES[case]
    made = FIELDS[kind](light, torch.Generator().manual_seed(seed))
    assert isinstance(made, nn.Module)
    return made.double()


def some_rays(count: int, seed: int = 0) -> tuple[torch.Tensor, torch.Tensor]:
    generator = torch.Generator().manual_seed(seed)
    points = torch.rand(count, 3, generator=generator, dtype=torch.float64) * 2 - 1
    return points, normalize(torch.randn(count, 3, generator=generator, dtype=torch.float64))


def weights_between(count: int, coordinate: float) -> list[float]:
    """The share of each node in linear interpolation, as hat functions."""
    distance = 2 / (count - 1)
    return [max(0.0, 1 - abs(coordinate - node) / distance) for node in axis_nodes(count).tolist()]


def on_axis(table: torch.Tensor, coordinate: float) -> torch.Tensor:
    weights = torch.tensor(weights_between(len(table), coordinate), dtype=table.dtype)
    return torch.einsum("k,kd->d", weights, table)


def on_square(table: torch.Tensor, u: float, v: float) -> torch.Tensor:
    """``table`` [side side D], row for the second coordinate."""
    columns, rows = (torch.tensor(weights_between(len(table), at), dtype=table.dtype) for at in (u, v))
    return torch.einsum("j,i,jid->d", rows, columns, table)


def sewn_by_hand(table: torch.Tensor) -> torch.Tensor:
    """Nodes of the octahedral square that show one direction share the mean of theirs, found by their directions."""
    side = len(table)
    directions = octahedral_nodes(side).double()
    same = (directions @ directions.T > 1 - 1e-6).double()
    flat = table.flatten(0, 1)
    return ((same @ flat) / same.sum(1, keepdim=True)).reshape(table.shape)


def cores_of(field: nn.Module) -> torch.Tensor:
    """The channel core, free or of its network at places that are evenly spaced on [-1, 1]."""
    if field.channels is None:
        return field.core
    places = torch.linspace(-1, 1, RING.features, dtype=torch.float64)[:, None]
    return field.channels(places)[0]


def by_formula(kind: str, field: nn.Module, point: torch.Tensor, direction: torch.Tensor) -> torch.Tensor:
    """Features of one ray, with every network run at the ray."""
    p, rank = point.tolist(), RING.rank
    uv = octahedral_from_directions(direction[None])[0].tolist()
    if kind == "discrete":
        x, y, z = (on_axis(field.axes[d], p[d]).reshape(rank, rank) for d in range(3))
        view = on_square(sewn_by_hand(field.view), *uv).reshape(rank, rank)
        return torch.einsum("ab,bc,cd,de,fea->f", x, y, z, view, field.core)
    if kind == "vm":
        x, y, z = p
        products = [
            on_square(field.planes[0], x, y) * on_axis(field.lines[0], z),
            on_square(field.planes[1], x, z) * on_axis(field.lines[1], y),
            on_square(field.planes[2], y, z) * on_axis(field.lines[2], x),
        ]
        return field.basis @ (torch.cat(products) * on_square(sewn_by_hand(field.view), *uv))
    if kind == "mlp":
        values = torch.cat([fourier_features(point[None], CODE), fourier_features(direction[None], CODE)], -1)
        for layer in [layer for layer in field.network if isinstance(layer, nn.Linear)]:
            values = layer(values.relu() if values.shape[-1] != 30 else values)
        return values[0]
    view = field.view(direction[None])[0]
    if kind == "cp":
        x, y, z = (field.axes(point[None])[d][0] for d in range(3))
        return torch.einsum("d,d,d,d,fd->f", x, y, z, view, cores_of(field))
    if kind == "tt":
        first = field.first(point[None, :1])[0, 0]
        second, third = field.middle(point[None, 1:])[:, 0].reshape(2, rank, rank)
        return torch.einsum("a,ab,bc,cd,fd->f", first, second, third, view.reshape(rank, rank), cores_of(field))
    x, y, z = field.axes(point[None])[:, 0].reshape(3, rank, rank)
    core = cores_of(field).reshape(-1, rank, rank)
    return torch.einsum("ab,bc,cd,de,fea->f", x, y, z, view.reshape(rank, rank), core)


@pytest.mark.parametrize("case", CASES)
def test_value_is_that_of_the_formula(case: str) -> None:
    kind, field = CASES[case][0], field_of(case)
    assert isinstance(field, LightField)
    points, directions = some_rays(12)
    expected = torch.stack([by_formula(kind, field, *ray) for ray in zip(points, directions, strict=True)])
    assert expected.shape == (12, RING.features)
    assert expected.std() > 0
    torch.testing.assert_close(field.exact(points, directions), expected, rtol=1e-6, atol=1e-9)


@pytest.mark.parametrize("kind", CASES)
@pytest.mark.parametrize("way", [lambda field, *rays: field.exact(*rays), tabulated_features])
def test_gradients_are_those_of_finite_differences(kind: str, way: Callable[..., torch.Tensor]) -> None:
    field = field_of(kind)
    rays = some_rays(4, seed=3)
    names = [name for name, _ in field.named_parameters()]

    def features(*values: torch.Tensor) -> torch.Tensor:
        result: torch.Tensor = torch.func.functional_call(
            _Called(field, way), {f"field.{name}": value for name, value in zip(names, values, strict=True)}, rays
        )
        return result

    assert_gradients(features, [p.detach().requires_grad_() for p in field.parameters()])


class _Called(nn.Module):
    """A field with one of its ways of evaluation as ``forward``, which torch can call with other parameters."""

    def __init__(self, field: nn.Module, way: Callable[..., torch.Tensor]):
        super().__init__()
        self.field, self.way = field, way

    def forward(self, points: torch.Tensor, directions: torch.Tensor) -> torch.Tensor:
        features: torch.Tensor = self.way(self.field, points, directions)
        return features


@pytest.mark.parametrize("kind", CASES)
def test_the_start_depends_on_the_seed_only(kind: str) -> None:
    first, again, other = field_of(kind, 1), field_of(kind, 1), field_of(kind, 2)
    pairs = list(zip(first.parameters(), again.parameters(), other.parameters(), strict=True))
    assert pairs
    assert all(torch.equal(a, b) and not torch.equal(a, c) for a, b, c in pairs)


@pytest.mark.parametrize("kind", FIELDS)
def test_tables_are_the_tabulated_field(kind: str) -> None:
    field = field_of(kind)
    rays = some_rays(50)
    tables = field.tables(Want.EXACT)
    assert (tables is not None) == (kind in ("ring", "discrete", "cp", "tt")), "what the kernel can read"
    direct = tabulated_features(field, *rays)
    torch.testing.assert_close(tabulated_features(field, *rays, tables), direct, rtol=1e-12, atol=1e-14)
    if kind in NEURAL:
        assert not torch.allclose(direct, field.exact(*rays))
    else:
        torch.testing.assert_close(direct, field.exact(*rays), rtol=1e-12, atol=1e-14)


@pytest.mark.parametrize("kind", [case for case, (kind, _) in CASES.items() if kind not in ("vm", "mlp")])
@pytest.mark.parametrize("double", [True, False])
def test_tables_know_their_way_back(kind: str, double: bool) -> None:
    """From gradients of tables to those of parameters, by name: those of the graph that makes tables anew."""
    field = field_of(kind).to(torch.float64 if double else torch.float32)
    points, directions = (tensor.to(next(field.parameters())) for tensor in some_rays(50))
    features = tabulated_features(field, points, directions)
    upstream = torch.randn(features.shape, generator=torch.Generator().manual_seed(5)).to(features)
    names = [name for name, _ in field.named_parameters()]
    expected = dict(zip(names, torch.autograd.grad(features, list(field.parameters()), upstream), strict=True))
    tables = field.tables(Want.GRADIENTS)
    assert all(table.grad_fn is None for table in (tables.axes, tables.view, tables.core))
    leaves = replace(
        tables, **{name: getattr(tables, name).detach().requires_grad_() for name in ("axes", "view", "core")}
    )
    again = tabulated_features(field, points, directions, leaves)
    by_tables = torch.autograd.grad(again, [leaves.axes, leaves.view, leaves.core], upstream)
    found = tables.backward(RingTables(*by_tables, tables.diagonal))
    assert found.keys() == expected.keys()
    tolerance = 1e-9 if double else 1e-4
    for name, gradient in expected.items():
        if IN_BFLOAT16 and not double:
            assert (found[name] - gradient).norm() <= NEAR_KINKS * gradient.norm(), name
            continue
        largest = gradient.abs().max().item()
        torch.testing.assert_close(found[name], gradient, rtol=0, atol=tolerance * largest)
    with pytest.raises(RuntimeError, match=r"ask for it with Want\.GRADIENTS"):
        field.tables(Want.EXACT).backward(tables)


@pytest.mark.parametrize("kind", NEURAL)
def test_at_the_nodes_tables_are_exact(kind: str) -> None:
    field = field_of(kind)
    axis = axis_nodes(RING.position_nodes).double()
    points = torch.stack([axis, axis.flip(0), axis.roll(2)], -1)
    directions = octahedral_nodes(RING.view_nodes).double()[5 : 5 + len(points)]
    exact = field.exact(points, directions)
    # The nodes themselves are float32.
    torch.testing.assert_close(tabulated_features(field, points, directions), exact, rtol=1e-4, atol=1e-6)


@pytest.mark.parametrize("kind", FIELDS)
def test_features_are_continuous_over_the_seam_of_the_octahedral_square(kind: str) -> None:
    field = field_of(kind)
    angles = torch.linspace(0.05, 6.2, 40, dtype=torch.float64)
    low = torch.full_like(angles, -0.8)
    # Both sides of the planes x = 0 and y = 0 below the equator, where the square is cut open.
    across = 1e-7
    for one, other in ((across, -across),):
        near = torch.stack([torch.full_like(angles, one), angles.sin(), low], -1)
        far = torch.stack([torch.full_like(angles, other), angles.sin(), low], -1)
        points = some_rays(len(angles))[0]
        difference = tabulated_features(field, points, normalize(near)) - tabulated_features(
            field, points, normalize(far)
        )
        assert difference.abs().max() < 1e-5


def test_the_diagonal_ring_holds_as_many_numbers_as_the_full_one() -> None:
    count: Callable[[nn.Module], int] = lambda field: sum(p.numel() for p in field.parameters())  # noqa: E731
    assert count(field_of("cp")) == count(field_of("ring")) == ring_size(RING)


@pytest.mark.parametrize("ring", [RingSettings(), RING])
@pytest.mark.parametrize("layers", [1, 2, 3])
def test_the_matched_network_is_of_the_rings_size(ring: RingSettings, layers: int) -> None:
    generator = torch.Generator()
    network = PerceptronField(ring, PerceptronSettings(0, layers), generator)
    held = sum(p.numel() for p in network.parameters())
    wanted = sum(p.numel() for p in TensorRing(ring, generator).parameters())
    width = matched_width(ring, layers)
    one_more = sum(
        p.numel() for p in PerceptronField(ring, PerceptronSettings(width + 1, layers), generator).parameters()
    )
    assert abs(held - wanted) <= abs(one_more - wanted)
    assert abs(held / wanted - 1) < (0.01 if ring == RingSettings() else 0.1)


def test_sizes_out_of_range_are_named() -> None:
    with pytest.raises(RecipeError, match=r"light\.knots\.axis is 1; give 2"):
        KnotSettings(axis=1)
    with pytest.raises(RecipeError, match=r"light\.vm\.components is 0"):
        VectorMatrixSettings(components=0)
    with pytest.raises(RecipeError, match=r"light\.mlp\.layers is 17"):
        PerceptronSettings(layers=17)
