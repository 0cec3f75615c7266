"""Presets with settings that make them small, without a test that knows what kind of recipe each is."""

import dataclasses
from collections.abc import Mapping
from typing import Any

from ringlight.methods.splat_recipe import SplatRecipe
from ringlight.methods.table import CHOOSERS, METHODS

TRAINED = tuple(name for name in METHODS if name not in CHOOSERS)
"""What runs and files are of; a chooser settles on one of these."""

SPLATS = tuple(name for name in TRAINED if isinstance(METHODS[name], SplatRecipe))
"""Those of them whose models are tables of Gaussians."""

COARSE = {
    "first_side": 12,
    "last_side": 20,
    "coarsest": 8,
    "finest": 16,
    "rays": 256,
    "scaled": 0.6,
    "bounds": (-1.3, -1.3, -0.9, 1.3, 1.3, 0.9),
}
"""Settings of volumes for the tiny scene at a few pixels: its box is not carved from masks anew each time."""

SMALL = COARSE | {
    "consistency_every": 2,
    "consistency_until": 0.8,
    "light": {
        "ring": {"rank": 4, "features": 6, "head_hidden": 8, "position_nodes": 16, "view_nodes": 4},
        "render_hidden": 8,
        "modulation_hidden": 8,
        "side": 8,
        "components": 4,
        "features": 6,
        "hidden": 8,
    },
}


def small(method: str, **settings: object) -> Any:
    """The preset, small, with these settings."""
    return with_settings(METHODS[method], SMALL | settings)


def with_settings(record: Any, settings: Mapping[str, object]) -> Any:
    """The record with those of the settings that it has; a mapping changes settings inside a group."""
    known = {field.name for field in dataclasses.fields(record)}
    changes = {
        name: with_settings(getattr(record, name), value) if isinstance(value, Mapping) else value
        for name, value in settings.items()
        if name in known
    }
    return dataclasses.replace(record, **changes)
