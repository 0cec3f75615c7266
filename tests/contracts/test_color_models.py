"""What every colour model must do, parametrised over all that are plugged in."""

from collections.abc import Sequence

import pytest
import torch
from torch import Tensor, nn

from contracts.differences import TOLERANCE, slopes_differ
from contracts.plugged import COLOR_MODELS
from in_bfloat16 import IN_BFLOAT16, NEAR_KINKS
from ringlight.color.contract import ColorModel
from ringlight.core.camera import Camera
from ringlight.core.directions import normalize
from ringlight.core.gaussians import Gaussians
from ringlight.core.gradients import COLOR, COLUMNS, Gradients, dense
from ringlight.core.rendering import Emission
from ringlight.core.scene import PointCloud
from ringlight.core.want import Want
from ringlight.files.ply import REST_COUNTS

COUNT = 40
ROUNDING = 2e-4
"""Of the largest gradient: float32 against float64, through tables and networks."""
SAME = 1e-6
"""Products of matrices round otherwise in another order of rows; of the kernels tests/color ask for the same bits."""

pytestmark = [pytest.mark.parametrize("name", COLOR_MODELS)]


def camera() -> Camera:
    pose = torch.eye(4)
    pose[2, 3] = 4.0
    return Camera(pose, (60.0, 60.0), (32.0, 32.0), 64, 64)


def model_and_table(name: str, count: int = COUNT) -> tuple[nn.Module, Gaussians]:
    model, drawn = COLOR_MODELS[name](), torch.Generator().manual_seed(2)
    positions = torch.randn(count, 3, generator=drawn) * 0.5
    normals = normalize(torch.randn(count, 3, generator=drawn))
    points = PointCloud(positions, 0.3 + 0.4 * torch.rand(count, 3, generator=drawn), normals)
    columns = {
        column: values + 0.02 * torch.randn(values.shape, generator=drawn) if values.is_floating_point() else values
        for column, values in model.new_columns(points).items()
    }
    # Three axes of clearly different lengths, so that the shortest is the same a step away.
    scales = torch.tensor([-3.0, -3.5, -4.5]).repeat(count, 1)
    quats = torch.randn(count, 4, generator=drawn)
    return model, Gaussians(positions, scales, quats, torch.zeros(count), columns)


def doubled(model: nn.Module, table: Gaussians) -> tuple[nn.Module, Gaussians]:
    return model.double(), Gaussians.from_columns({n: column.double() for n, column in table.columns().items()})


def emitted(model: nn.Module, table: Gaussians, want: Want, names: Sequence[str] | None = None) -> Emission:
    return model.emit(table, camera(), tuple(model.emits) if names is None else names, want)


def upstream(emission: Emission) -> tuple[Tensor, Tensor | None]:
    drawn = torch.Generator().manual_seed(3)
    channels = torch.randn(emission.channels.shape, generator=drawn, dtype=torch.float64).to(emission.channels)
    if emission.opacity_factor is None:
        return channels, None
    factor = torch.randn(len(channels), generator=drawn, dtype=torch.float64).to(channels)
    return channels, factor


def gradients_of(model: nn.Module, table: Gaussians) -> dict[str, Tensor]:
    emission, into = emitted(model, table, Want.GRADIENTS), Gradients()
    emission.backward(*upstream(emission), into)
    return {name: dense(gradient) for name, gradient in into.items()}


def test_it_emits_what_it_says(name: str):
    model, table = model_and_table(name)
    assert isinstance(model, ColorModel)
    assert model.emits["rgb"] == 3
    emission = emitted(model, table, Want.EXACT)
    assert dict(emission.widths) == dict(model.emits)
    assert emission.channels.shape == (COUNT, sum(model.emits.values()))
    assert emission.channels.isfinite().all()
    if emission.opacity_factor is not None:
        assert emission.opacity_factor.shape == (COUNT,)
        assert (emission.opacity_factor >= 0).all()
        assert (table.opacities * emission.opacity_factor <= 1 + SAME).all()


def test_rgb_alone_is_the_same_rgb(name: str):
    model, table = model_and_table(name)
    alone, among = (emitted(model, table, Want.EXACT, names).named()["rgb"] for names in (("rgb",), tuple(model.emits)))
    torch.testing.assert_close(alone, among, rtol=0, atol=SAME)


@pytest.mark.parametrize("ambient", [torch.no_grad, torch.enable_grad])
def test_the_call_says_what_is_wanted_and_nothing_else_does(name: str, ambient: type):
    model, table = model_and_table(name)
    with ambient():
        kinds = {want: emitted(model, table, want).channels for want in Want}
    assert torch.equal(kinds[Want.GRADIENTS], kinds[Want.EXACT])
    assert torch.equal(kinds[Want.PICTURE], emitted(model, table, Want.PICTURE).channels)
    assert not any(channels.requires_grad for channels in kinds.values())
    with pytest.raises(RuntimeError, match="no way back"):
        emitted(model, table, Want.EXACT).backward(kinds[Want.EXACT], None, Gradients())


def test_gradients_are_finite_and_everything_gets_one(name: str):
    model, table = model_and_table(name)
    found = gradients_of(model, table)
    owned = [COLUMNS + column for column in table.appearance] + [COLOR + n for n, _ in model.named_parameters()]
    assert set(owned) <= found.keys()
    shapes = {COLUMNS + n: c.shape for n, c in table.columns().items()}
    shapes |= {COLOR + n: p.shape for n, p in model.named_parameters()}
    for parameter, gradient in found.items():
        assert gradient.shape == shapes[parameter], parameter
        assert gradient.isfinite().all(), parameter
        assert gradient.any(), parameter


def test_points_that_are_black_learn_to_be_brighter(name: str):
    """A harmonic colour that is clamped at black would stay there for the whole run, and all copies of it with it."""
    model, points = COLOR_MODELS[name](), PointCloud(torch.randn(9, 3), torch.zeros(9, 3), torch.eye(3).repeat(3, 1))
    table = Gaussians(points.positions, -3 * torch.ones(9, 3), torch.eye(4)[:1].repeat(9, 1), torch.zeros(9))
    table.appearance.update(model.new_columns(points))
    if "sh_dc" not in table.appearance:
        pytest.skip("has no harmonics")
    emission, into = model.emit(table, camera(), ("rgb",), Want.GRADIENTS), Gradients()
    brighter = torch.zeros(emission.channels.shape)
    brighter[:, :3] = 1
    emission.backward(brighter, None if emission.opacity_factor is None else torch.zeros(9), into)
    assert (dense(into[COLUMNS + "sh_dc"]) > 0).all()


def test_gradients_agree_with_finite_differences(name: str):
    model, table = doubled(*model_and_table(name))
    found = gradients_of(model, table)
    leaves = {COLUMNS + n: c for n, c in table.columns().items()} | {COLOR + n: p for n, p in model.named_parameters()}
    # A mask is a step: its gradient is a sigmoid's by design, and no difference shows it.
    leaves = {n: leaf for n, leaf in leaves.items() if n in found and not n.endswith("mask_logits")}

    def value() -> Tensor:
        emission = emitted(model, table, Want.EXACT)
        grad_channels, grad_factor = upstream(emission)
        total = (emission.channels * grad_channels).sum()
        if grad_factor is not None and emission.opacity_factor is not None:
            total = total + (emission.opacity_factor * grad_factor).sum()
        return total

    for leaf, error in slopes_differ(value, leaves, found).items():
        assert error < TOLERANCE, leaf


def test_kernels_have_the_gradients_of_torch(name: str):
    model, table = model_and_table(name)
    single = gradients_of(model, table)
    double = gradients_of(*doubled(model, table))
    assert single.keys() == double.keys()
    for parameter, gradient in double.items():
        if IN_BFLOAT16:
            assert (single[parameter] - gradient).norm() <= NEAR_KINKS * gradient.norm() + 1e-6, parameter
            continue
        error = (single[parameter].double() - gradient).abs().max()
        assert error <= ROUNDING * gradient.abs().max() + 1e-6, parameter


def test_the_order_of_rows_changes_nothing(name: str):
    model, table = model_and_table(name)
    order = torch.randperm(COUNT, generator=torch.Generator().manual_seed(5))
    usual, turned = emitted(model, table, Want.EXACT), emitted(model, table.rows(order), Want.EXACT)
    torch.testing.assert_close(turned.channels, usual.channels[order], rtol=SAME, atol=SAME)
    if usual.opacity_factor is not None:
        torch.testing.assert_close(turned.opacity_factor, usual.opacity_factor[order], rtol=SAME, atol=SAME)
    assert torch.equal(model.wanted(table.rows(order)), model.wanted(table)[order])


def test_its_state_is_all_of_it(name: str):
    model, table = model_and_table(name)
    with torch.no_grad():
        for parameter in model.parameters():
            parameter.add_(0.01)
    again = COLOR_MODELS[name]()
    again.load_state_dict(model.state_dict())
    assert torch.equal(emitted(again, table, Want.EXACT).channels, emitted(model, table, Want.EXACT).channels)


def test_a_gaussian_seen_from_its_own_centre_is_finite(name: str):
    """Point clouds may hold the cameras' centres; nothing of such a row is drawn."""
    model, table = model_and_table(name)
    table.means[7] = camera().position
    assert emitted(model, table, Want.EXACT).channels.isfinite().all()
    assert all(layer.isfinite().all() for layer in model.layers(table, camera()).values())
    emission, into = emitted(model, table, Want.GRADIENTS), Gradients()
    by_channels, by_factor = upstream(emission)
    by_channels[7] = 0
    if by_factor is not None:
        by_factor[7] = 0
    emission.backward(by_channels, by_factor, into)
    assert all(dense(gradient).isfinite().all() for _, gradient in into.items())
    double, rows = doubled(model, table)
    assert emitted(double, rows, Want.EXACT).channels.isfinite().all()


def test_no_rows_are_fine(name: str):
    model, table = model_and_table(name)
    none = table.rows(torch.zeros(0, dtype=torch.int64))
    assert emitted(model, none, Want.EXACT).channels.shape == (0, sum(model.emits.values()))
    assert all(gradient.isfinite().all() for gradient in gradients_of(model, none).values())


def test_layers_and_harmonics_have_a_row_a_gaussian(name: str):
    model, table = model_and_table(name)
    assert all(len(layer) == COUNT and layer.isfinite().all() for layer in model.layers(table, camera()).values())
    exact = model.harmonics(table)
    if exact is not None:
        assert exact.sh_dc.shape == (COUNT, 3)
        assert exact.sh_rest.shape in [(COUNT, harmonics, 3) for harmonics in REST_COUNTS.values()]
