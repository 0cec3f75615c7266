"""The kernels show and differentiate what the reference does, with the same bits for any number of threads."""

import weakref

import pytest
import torch
from torch import Tensor

from ringlight import _kernels
from ringlight.core.rendering import Rendering
from ringlight.core.want import Want
from ringlight.data.rays import RayBatch
from ringlight.volume import halves as of_halves
from ringlight.volume import model as of_model
from ringlight.volume import native_march
from ringlight.volume.occupancy import is_occupied
from volume.volumes import BACKGROUND, rays, volume, volume_of_trains

RAYS = 300

EXACT, HALVED = (6e-5, 1e-4), (5e-3, 0.1)
"""Of colours, and of gradients as a share of their length: rounding of floats, and of bfloat16, which turns units of
the network on and off; test_shading_kernel.py compares products of bfloat16 with rounded factors."""


def predicted(model: of_model.VolumeModel, native: bool, monkeypatch: pytest.MonkeyPatch) -> Rendering:
    with monkeypatch.context() as patch:
        if not native:
            patch.setattr(of_model, "runs_native", lambda *_: False)
        through = rays(RAYS)
        batch = RayBatch(through, torch.zeros(RAYS, 3), BACKGROUND)
        assert ("cpu" in model.renderer) is native
        return model.predict(batch, Want.GRADIENTS)


def gradients(shown: Rendering) -> dict[str, Tensor]:
    drawn = torch.Generator().manual_seed(7)
    color, alpha, depth = (torch.randn(RAYS, width, generator=drawn) for width in (3, 1, 1))
    return dict(shown.backward(color, {"alpha": alpha, "depth": depth}))


VOLUMES = {
    "planes times lines": volume,
    "lines": lambda: volume("cp", (96, 288)),
    "planes times lines of no sixteen components": lambda: volume("vm", (12, 20)),
    "tensor trains": volume_of_trains,
}


@pytest.mark.parametrize(("halves", "tolerance"), [(False, EXACT), (True, HALVED)])
@pytest.mark.parametrize("kind", VOLUMES)
def test_they_equal_the_reference(
    kind: str, halves: bool, tolerance: tuple[float, float], monkeypatch: pytest.MonkeyPatch
):
    monkeypatch.setattr(of_halves, "HALVES", halves)
    model = VOLUMES[kind]()
    ours, reference = (predicted(model, native, monkeypatch) for native in (True, False))
    assert 0.2 < reference.alpha.mean() < 0.8
    assert reference.alpha.min() == 0
    assert reference.alpha.max() > 0.999
    of_colors, of_gradients = tolerance
    torch.testing.assert_close(ours.color, reference.color, rtol=0, atol=of_colors)
    for name in ("alpha", "depth"):
        torch.testing.assert_close(ours.buffers[name], reference.buffers[name], rtol=0, atol=EXACT[0])
    found, expected = gradients(ours), gradients(reference)
    assert found.keys() == expected.keys() == dict(model.named_parameters()).keys()
    for name, gradient in expected.items():
        assert (found[name] - gradient).norm() < of_gradients * gradient.norm(), name


@pytest.mark.parametrize("kind", ["planes times lines", "lines"])
def test_the_density_of_places_is_the_fields_and_none_where_it_is_empty(kind: str):
    model = VOLUMES[kind]()
    places = torch.rand(1003, 3, generator=torch.Generator().manual_seed(3)) * 1.2 - 0.1
    there = is_occupied(model.occupied, places)
    assert 0.5 < there.float().mean() < 0.9
    wanted = torch.where(there, model.density(places).detach(), 0)
    torch.testing.assert_close(model.density_values(places), wanted, rtol=1e-4, atol=1e-4)


def test_a_ray_meets_something_where_the_reference_says_so_and_as_often(monkeypatch: pytest.MonkeyPatch):
    model, through = volume(), rays(2000)
    ours, often = model.meets_something(through), model.samples_of(through, 2.5)
    monkeypatch.setattr(of_model, "runs_native", lambda *_: False)
    assert 0 < ours.sum() < len(through)
    assert (ours != model.meets_something(through)).float().mean() < 2e-3  # a sample on the border of a cell
    assert (often - model.samples_of(through, 2.5)).abs().float().mean() < 2e-3 * often.float().mean()
    assert int(often.sum()) == pytest.approx(2.5 * int(model.samples_of(through).sum()), rel=0.02)


@pytest.mark.usefixtures("all_cores_afterwards")
@pytest.mark.parametrize("kind", VOLUMES)
def test_bits_are_the_same_for_any_number_of_threads(kind: str, monkeypatch: pytest.MonkeyPatch):
    model = VOLUMES[kind]()
    model.gradient_share = 0.5
    torch.set_num_threads(1)  # as commands do
    states = []
    for threads in (1, 2, 4):
        _kernels.set_threads(threads)
        shown = predicted(model, True, monkeypatch)
        states.append([shown.color, shown.buffers["depth"], *gradients(shown).values()])
    for others in states[1:]:
        assert all(torch.equal(one, other) for one, other in zip(states[0], others, strict=True))


@pytest.mark.usefixtures("all_cores_afterwards")
@pytest.mark.parametrize("kind", VOLUMES)
def test_hidden_units_that_were_kept_change_no_bit(kind: str, monkeypatch: pytest.MonkeyPatch):
    """Of all samples, and where half of the rays hand nothing on."""
    monkeypatch.setattr(of_halves, "HALVES", False)
    torch.set_num_threads(1)
    model = VOLUMES[kind]()
    made: list[bool] = []
    room = native_march.room_for_units
    for module in ("factored_source", "torch_source"):
        path = f"ringlight.volume.{module}.room_for_units"
        monkeypatch.setattr(path, lambda *counts: made.append((kept := room(*counts)) is not None) or kept)
    states = []
    for most, threads in ((native_march.MOST_KEPT, 1), (native_march.MOST_KEPT, 4), (0, 1)):
        monkeypatch.setattr(native_march, "MOST_KEPT", most)
        _kernels.set_threads(threads)
        found: list[Tensor] = []
        for handing_on in (RAYS, RAYS // 2):
            shown = predicted(model, True, monkeypatch)
            of_color = torch.zeros(RAYS, 3)
            of_color[:handing_on] = torch.randn(handing_on, 3, generator=torch.Generator().manual_seed(7))
            found += [shown.color, *shown.backward(of_color, {}).values()]
        states.append(found)
    assert made == [True] * 4 + [False] * 2
    for others in states[1:]:
        assert all(torch.equal(one, other) for one, other in zip(states[0], others, strict=True))


@pytest.mark.parametrize("kind", VOLUMES)
def test_rays_that_meet_nothing_show_the_background(kind: str):
    model, through = VOLUMES[kind](), rays(5)
    model.occupied = torch.zeros(1, 1, 1, dtype=torch.uint8)
    batch = RayBatch(through, torch.zeros(5, 3), BACKGROUND)
    shown = model.predict(batch, Want.GRADIENTS)
    assert torch.equal(shown.color, BACKGROUND.expand(5, 3))
    found = shown.backward(torch.ones(5, 3), {})
    assert not any(gradient.any() for gradient in found.values())


@pytest.mark.parametrize("kind", VOLUMES)
def test_a_way_back_that_is_gone_lets_go_of_its_samples(kind: str, monkeypatch: pytest.MonkeyPatch):
    """Else those of the step before would lie beside a step's own."""
    shown = predicted(VOLUMES[kind](), True, monkeypatch)
    source, through, *_ = shown.backward.__self__._parts
    held = [weakref.ref(source), weakref.ref(through.places), weakref.ref(through.weights)]
    del source, through, _
    gradients(shown)
    assert [reference() for reference in held] == [None] * 3
    with pytest.raises(RuntimeError, match="march them again"):
        gradients(shown)


def test_a_density_that_is_no_number_is_seen():
    """It does not pass for matter: training names the step at which a loss was no number."""
    model = volume()
    with torch.no_grad():
        model.field.density_factors.planes[0][3:5] = float("nan")
    shown = model.predict(RayBatch(rays(RAYS), torch.zeros(RAYS, 3), BACKGROUND), Want.GRADIENTS)
    lost = shown.alpha[..., 0].isnan()
    assert 0 < lost.sum() < RAYS
    assert shown.color[lost].isnan().all()
    assert shown.color[~lost].isfinite().all()


def test_samples_that_are_not_placed_have_no_part_in_gradients(monkeypatch: pytest.MonkeyPatch):
    """A count of samples may be larger than what is placed; memory there may hold anything."""
    model = volume()
    batch = RayBatch(rays(RAYS), torch.zeros(RAYS, 3), BACKGROUND)
    expected = gradients(model.predict(batch, Want.GRADIENTS))
    counted, empty = native_march.samples_in, torch.empty
    monkeypatch.setattr(native_march, "samples_in", lambda *of: counted(*of) + 3)
    monkeypatch.setattr(native_march.torch, "empty", lambda *of, **how: _spoilt(empty(*of, **how)))
    found = gradients(model.predict(batch, Want.GRADIENTS))
    for name, gradient in expected.items():
        torch.testing.assert_close(found[name], gradient, rtol=1e-4, atol=1e-5)


def _spoilt(memory: Tensor) -> Tensor:
    return memory.fill_(float("nan")) if memory.is_floating_point() else memory


def test_what_they_do_not_take_is_shown_by_the_reference():
    model = volume().double()
    assert model.renderer == "ray marcher in torch"
    batch = RayBatch(rays(20), torch.zeros(20, 3), BACKGROUND)
    assert model.predict(batch, Want.EXACT).color.isfinite().all()


def test_kernels_refuse_what_does_not_fit():
    model = volume()
    factors = [*model.field.density_factors.planes, *model.field.density_factors.lines]
    with pytest.raises(ValueError, match="planes must be"):
        _kernels.volume_density([factors[1], factors[0], *factors[2:]], torch.zeros(4, 3), torch.zeros(4))
    with pytest.raises(ValueError, match="a density for each place"):
        _kernels.volume_density(factors, torch.zeros(4, 3), torch.zeros(5))
    samples = torch.tensor([0, 9], dtype=torch.int32)
    with pytest.raises(ValueError, match="out of range"):
        _kernels.volume_scatter(
            factors, torch.zeros(4, 3), samples, torch.zeros(2), [f.detach().clone() for f in factors]
        )
