import torch
from hypothesis import given, settings
from hypothesis import strategies as st

from ringlight.core.directions import normalize
from ringlight.core.want import Want
from ringlight.fields.ring_settings import RingSettings
from ringlight.fields.ring_tables import tabulated_features
from ringlight.fields.tables import axis_nodes, octahedral_nodes
from ringlight.fields.tensor_ring import TensorRing

SMALL = RingSettings(rank=3, features=5, head_hidden=8, bands=2, view_bands=2, position_nodes=4, view_nodes=3)


def ring(settings: RingSettings, seed: int = 0) -> TensorRing:
    return TensorRing(settings, torch.Generator().manual_seed(seed)).double()


def some_points(count: int, seed: int = 0) -> tuple[torch.Tensor, torch.Tensor]:
    generator = torch.Generator().manual_seed(seed)
    points = torch.rand(count, 3, generator=generator, dtype=torch.float64) * 2 - 1
    return points, normalize(torch.randn(count, 3, generator=generator, dtype=torch.float64))


def test_trace_formula_against_the_full_discrete_ring():
    model = ring(SMALL)
    tables = model.tables(Want.EXACT)
    rank = SMALL.rank
    cores = [table.unflatten(-1, (rank, rank)) for table in (*tables.axes, tables.view)]
    full = torch.einsum("xab,ybc,zcd,vde,fea->xyzvf", *cores, model.core)
    axis = axis_nodes(SMALL.position_nodes).double()
    where = torch.cartesian_prod(torch.arange(4), torch.arange(4), torch.arange(4), torch.arange(9))
    points = axis[where[:, :3]]
    directions = octahedral_nodes(SMALL.view_nodes).double()[where[:, 3]]
    expected = full[where.unbind(1)]
    torch.testing.assert_close(model.exact(points, directions), expected, rtol=1e-5, atol=1e-7)
    torch.testing.assert_close(tabulated_features(model, points, directions), expected, rtol=0, atol=1e-6)


def test_tables_approach_the_exact_heads():
    """Linear interpolation of a smooth function: the error falls with the square of the node distance.

    With 2 bands (period 1 on [-1, 1]) four times the nodes must divide the root-mean-square error by 16; ReLU
    kinks spoil the rate, so the test asks for 6, and for 1 % of the features' own spread at the finest tables.
    """
    points, directions = some_points(2000)
    errors = []
    for nodes, view_nodes in ((32, 16), (128, 64), (512, 256)):
        settings_ = RingSettings(
            rank=4, features=6, head_hidden=16, bands=2, view_bands=2, position_nodes=nodes, view_nodes=view_nodes
        )
        model = ring(settings_)
        exact = model.exact(points, directions)
        errors.append(
            ((tabulated_features(model, points, directions) - exact).square().mean().sqrt() / exact.std()).item()
        )
    assert errors[1] < errors[0] / 6
    assert errors[2] < errors[1] / 6
    assert errors[2] < 0.01


@settings(max_examples=15)
@given(rank=st.integers(1, 7), features=st.integers(1, 9), seed=st.integers(0, 100))
def test_every_parameter_gets_a_gradient(rank, features, seed):
    chosen = RingSettings(rank=rank, features=features, head_hidden=8, bands=3, position_nodes=16, view_nodes=4)
    model = ring(chosen, seed)
    features_ = tabulated_features(model, *some_points(30, seed))
    assert features_.shape == (30, features)
    features_.square().sum().backward()
    for name, parameter in model.named_parameters():
        assert parameter.grad is not None, name
        assert parameter.grad.isfinite().all(), name
        assert parameter.grad.any(), name


def test_start_depends_on_the_seed_only():
    first, again, other = ring(SMALL, 1), ring(SMALL, 1), ring(SMALL, 2)
    assert all(torch.equal(a, b) for a, b in zip(first.parameters(), again.parameters(), strict=True))
    assert not torch.equal(first.core, other.core)


def test_size_at_the_papers_settings():
    count = sum(p.numel() for p in TensorRing(RingSettings(), torch.Generator()).parameters())
    heads = 3 * (21 * 128 + 128 + 128 * 128 + 128 + 128 * 256 + 256)
    view = 63 * 128 + 128 + 128 * 128 + 128 + 128 * 256 + 256
    assert count == heads + view + 48 * 16 * 16
