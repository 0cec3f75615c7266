"""Every colour model can be timed by name."""

import pytest

from ringlight.bench.color import bench_color, color_models
from ringlight.bench.timing import Budget
from ringlight.errors import RecipeError
from ringlight.methods.table import METHODS


def test_each_model_gives_a_row_for_each_count():
    names = list(color_models())
    rows = bench_color(names, [64, 128], Budget(rounds=1, seconds=0.0))
    assert [(row.gaussians, row.model) for row in rows] == [(n, name) for n in (64, 128) for name in names]
    assert all(row.both.wall_ms > 0 for row in rows)


def test_light_fields_are_those_that_the_methods_train():
    models = color_models()
    for name, method in {"ring": "ringlight-ring", "ring-paper": "ringlight-paper"}.items():
        assert models[name].settings == METHODS[method].light


def test_unknown_models_are_refused_by_name():
    with pytest.raises(RecipeError, match="'shiny'"):
        bench_color(["shiny"], [10], Budget())
