"""Which features are saturated, and which are constant."""

import math

import pytest
import torch

from ringlight.core.light_features import FeatureShares, LightFeatures, evenly, flat_tanh, shares_of

SAMPLES = 1000


def waves(count: int, scale: float = 1.0) -> torch.Tensor:
    """Features that vary, of this amplitude."""
    phases = torch.linspace(0, 20 * math.pi, SAMPLES)[:, None] + torch.arange(count)
    return scale * phases.sin()


def squashed(features: torch.Tensor, hidden: torch.Tensor | None = None) -> LightFeatures:
    """Features before their tanh, and units of which none is off."""
    values = torch.tanh(features)
    return LightFeatures(values, flat_tanh(values), torch.ones(len(values), 2) if hidden is None else hidden)


def unbounded(features: torch.Tensor) -> LightFeatures:
    return LightFeatures(features, torch.zeros_like(features, dtype=torch.bool), torch.ones(len(features), 2))


def test_features_that_vary_within_their_range_are_neither():
    assert shares_of([squashed(waves(6))]) == FeatureShares(0.0, 0.0, 0.0)


@pytest.mark.parametrize("scale", [1e-4, 1.0, 1e4])
def test_features_of_maps_have_no_scale_and_never_saturate(scale: float):
    assert shares_of([unbounded(waves(5, scale))]) == FeatureShares(0.0, 0.0, 0.0)


def test_a_feature_at_either_end_is_saturated_and_constant_only_if_it_stays_at_one():
    ends = torch.where(waves(1) > 0, 20.0, -20.0)
    held = torch.full((SAMPLES, 1), -20.0)
    found = shares_of([squashed(torch.cat([ends, held, waves(2)], 1))])
    assert found == FeatureShares(saturated=0.5, constant=0.25, off=0.0)


def test_a_hundredth_of_the_samples_does_not_save_a_feature_and_more_does():
    features = torch.full((SAMPLES, 2), 20.0)
    features[:10, 0] = 0.0
    features[:11, 1] = 0.0
    found = shares_of([squashed(features)])
    assert found is not None
    assert found.saturated == 0.5


def test_what_hardly_varies_beside_its_size_is_constant():
    nothing, flat, offset = torch.zeros(SAMPLES, 1), 0.3 + waves(1, 0.004), 0.3 + waves(1, 0.006)
    assert shares_of([unbounded(torch.cat([nothing, flat, offset, waves(1)], 1))]) == FeatureShares(0.0, 0.5, 0.0)


def test_what_is_constant_in_each_view_but_not_over_them_varies():
    one, other = (unbounded(torch.full((SAMPLES, 1), value)) for value in (0.1, 0.2))
    assert shares_of([one, other]) == FeatureShares(0.0, 0.0, 0.0)
    assert shares_of([one, one]) == FeatureShares(0.0, 1.0, 0.0)


def test_units_that_are_zero_nearly_everywhere_are_off():
    units = torch.zeros(SAMPLES, 4)
    units[:10, 1] = 0.1
    units[:11, 2] = 1e-9
    units[:, 3] = waves(1)[:, 0].relu()
    found = shares_of([squashed(waves(6), units)])
    assert found == FeatureShares(0.0, 0.0, 0.5)


def test_without_samples_or_features_there_is_nothing_to_say():
    assert shares_of([]) is None
    assert shares_of([unbounded(torch.zeros(0, 3))]) is None
    assert shares_of([unbounded(torch.zeros(4, 0))]) is None


def test_samples_are_evenly_spread():
    assert evenly(3, 5).tolist() == [0, 1, 2]
    assert evenly(10, 4).tolist() == [0, 2, 5, 7]
    assert evenly(0).tolist() == []
