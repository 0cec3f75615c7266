"""The network's kernel makes colours and gradients of any widths as torch does, on every instruction set."""

from typing import Any

import pytest
import torch
from hypothesis import example, given, settings
from hypothesis import strategies as some
from torch import Tensor
from torch.func import functional_call, grad, vmap

from ringlight import _kernels
from ringlight.core.directions import normalize
from ringlight.methods.volume_recipe import MOST_UNITS
from ringlight.volume.shading import FeatureShading, waves

HALVES = _kernels.isa() in ("avx512_bf16", "avx512_amx")
"""Whether products are of bfloat16 where that is asked for."""

EXACT, ROUNDED = 2e-5, 3e-3
"""Differences of gradients as shares of what they add up. A product of bfloat16 rounds a sum that lies between two
numbers up or down by its order, and what follows with it."""

KINK, ROUNDED_KINK = 1e-5, 1e-3
"""A unit this near to zero is on or off by the order of a sum; such samples get no gradient here. The second is behind
waves or units that are rounded up or down by their last bit."""


class _RoundedLinear(torch.autograd.Function):
    """A layer whose products have factors of bfloat16, and sums of float32, there and back."""

    @staticmethod
    def forward(ctx: Any, rows: Tensor, weight: Tensor, bias: Tensor) -> Tensor:
        ctx.save_for_backward(rows, weight)
        return rounded(rows) @ rounded(weight).T + bias

    @staticmethod
    def backward(ctx: Any, *gradients: Tensor) -> tuple[Tensor, Tensor, Tensor]:
        rows, weight = ctx.saved_tensors
        gradient = rounded(gradients[0])
        return gradient @ rounded(weight), gradient.T @ rounded(rows), gradients[0].sum(0)


def rounded(values: Tensor) -> Tensor:
    return values.bfloat16().float()


def by_torch(shading: FeatureShading, features: Tensor, directions: Tensor, halves: bool) -> Tensor:
    rows = torch.cat([features, directions, waves(features), waves(directions)], -1)
    if not halves:
        return shading(features, directions)
    layers = [layer for layer in shading.network if isinstance(layer, torch.nn.Linear)]
    for layer in layers[:-1]:
        rows = _RoundedLinear.apply(rows, layer.weight, layer.bias).relu()
    last = layers[-1]
    return _RoundedLinear.apply(rows, last.weight, last.bias).sigmoid()


def at_kinks(shading: FeatureShading, features: Tensor, directions: Tensor, halves: bool) -> Tensor:
    """Which samples have a unit that is neither on nor off."""
    rows = torch.cat([features, directions, waves(features), waves(directions)], -1)
    layers = [layer for layer in shading.network if isinstance(layer, torch.nn.Linear)]
    found = torch.zeros(len(rows), dtype=torch.bool)
    kink = ROUNDED_KINK if halves else KINK
    for layer in layers[:-1]:
        rows = (rounded(rows) @ rounded(layer.weight).T + layer.bias) if halves else layer(rows)
        found |= (rows.abs() < kink).any(1)
        rows = rows.relu()
    return found


def added_lengths(shading: FeatureShading, features: Tensor, directions: Tensor, grad_colors: Tensor) -> list[Tensor]:
    """Of each parameter the length of its gradients by single samples, added up without their signs."""
    named = {name: parameter.detach() for name, parameter in shading.named_parameters()}

    def of_sample(values: dict[str, Tensor], row: Tensor, direction: Tensor, upstream: Tensor) -> Tensor:
        color = functional_call(shading, values, (row[None], direction[None]))
        return (color[0] * upstream).sum()

    single = vmap(grad(of_sample), in_dims=(None, 0, 0, 0))(named, features, directions, grad_colors)
    return [single[name].abs().sum(0).norm() for name in named]


def compared(widths: tuple[int, int], count: int, seed: int, halves: bool) -> tuple[float, float]:
    """Largest difference of colours, and of gradients as a share of the length of what each adds up: samples may cancel
    each other, and rounding stays."""
    features, hidden = widths
    drawn = torch.Generator().manual_seed(seed)
    shading = FeatureShading(features, hidden, drawn)
    seen = torch.randn(count, features, generator=drawn).requires_grad_()
    directions = normalize(torch.randn(7, 3, generator=drawn))
    rays = torch.randint(7, (count,), generator=drawn).int()
    network = [parameter.detach() for parameter in shading.parameters()]
    colors = torch.full((count, 3), float("nan"))
    units = torch.full((2, count, hidden), float("nan"))
    _kernels.volume_shade(seen.detach(), network, rays, directions, halves, colors, units)
    expected = by_torch(shading, seen, directions[rays.long()], halves and HALVES)
    grad_colors = torch.randn(count, 3, generator=drawn)
    grad_colors[at_kinks(shading, seen.detach(), directions[rays.long()], halves and HALVES)] = 0
    wanted = torch.autograd.grad((expected * grad_colors).sum(), [seen, *shading.parameters()])
    found = [torch.full_like(gradient, float("nan")) for gradient in wanted]
    again = [torch.full_like(gradient, float("nan")) for gradient in wanted]
    for kept, into in ((units, found), (None, again)):
        _kernels.volume_shade_gradient(
            seen.detach(), network, rays, directions, halves, kept, grad_colors, into[0], into[1:]
        )
    assert all(map(torch.equal, found, again))
    lengths = [wanted[0].norm(), *added_lengths(shading, seen.detach(), directions[rays.long()], grad_colors)]
    differences = [(a - b).norm() for a, b in zip(found, wanted, strict=True)]
    shares = [float(a / b.clamp_min(1e-6)) for a, b in zip(differences, lengths, strict=True)]
    return float((colors - expected.detach()).abs().max()), max(shares)


@given(some.integers(1, 64), some.integers(1, 128), some.integers(1, 300), some.integers(0, 1000))
@settings(deadline=None, max_examples=30)
def test_any_widths_and_rows_give_what_torch_gives(features: int, hidden: int, count: int, seed: int):
    of_colors, of_gradients = compared((features, hidden), count, seed, halves=False)
    assert of_colors < 2e-6
    assert of_gradients < EXACT


@given(some.integers(1, 64), some.integers(1, 128), some.integers(8, 300), some.integers(0, 1000))
@example(30, 104, 237, 1000)  # a unit goes on by the rounding of one before it
@example(6, 16, 50, 38)  # or of a wave
@settings(deadline=None, max_examples=30)
def test_products_of_halves_give_what_torch_gives_with_rounded_factors(
    features: int, hidden: int, count: int, seed: int
):
    of_colors, of_gradients = compared((features, hidden), count, seed, halves=True)
    assert of_colors < 2e-3
    assert of_gradients < ROUNDED


def test_sines_of_features_beyond_what_they_are_made_for_stay_between_minus_one_and_one():
    shading = FeatureShading(1, 1, torch.Generator())
    network = [torch.zeros_like(parameter) for parameter in shading.parameters()]
    network[0][0, 4] = 1.0  # behind the feature and the direction
    network[1].fill_(1.5)
    network[2].fill_(1.0)
    network[4].fill_(1.0)
    features = 10.0 ** torch.linspace(-3, 30, 1000)[:, None]
    directions, rays = torch.tensor([[0.0, 0.0, 1.0]]), torch.zeros(1000, dtype=torch.int32)
    colors = torch.full((1000, 3), float("nan"))
    _kernels.volume_shade(features, network, rays, directions, False, colors, None)
    made = colors.logit() - 1.5
    assert made.min() > -1.001
    assert made.max() < 1.001
    torch.testing.assert_close(made[:100], features[:100].sin().expand(100, 3), rtol=0, atol=1e-5)


def test_hidden_units_of_other_rows_are_refused():
    shading = FeatureShading(4, 8, torch.Generator())
    network = [parameter.detach() for parameter in shading.parameters()]
    features, rays, directions = torch.rand(5, 4), torch.zeros(5, dtype=torch.int32), torch.tensor([[0.0, 0.0, 1.0]])
    with pytest.raises(ValueError, match="hidden units must be of two layers and all rows"):
        _kernels.volume_shade(features, network, rays, directions, False, torch.empty(5, 3), torch.empty(2, 4, 8))
    gradients = [torch.empty_like(tensor) for tensor in (features, *network)]
    with pytest.raises(ValueError, match="hidden units must be of two layers and all rows"):
        _kernels.volume_shade_gradient(
            features,
            network,
            rays,
            directions,
            False,
            torch.rand(2, 4, 8),
            torch.rand(5, 3),
            gradients[0],
            gradients[1:],
        )


def test_the_widest_network_that_a_recipe_may_ask_for_is_taken():
    of_colors, of_gradients = compared((MOST_UNITS, 8), 3, 0, halves=False)
    assert of_colors < 1e-5
    assert of_gradients < 1e-3
