"""Under which name a recipe was asked for."""

import dataclasses

from ringlight.cli.methods import preset_of
from ringlight.methods.table import METHODS

PAPER = METHODS["ringlight-paper"]


def test_a_folder_may_be_called_like_a_preset():
    assert preset_of(["ringlight-ring", "ringlight-paper"], PAPER) == "ringlight-paper"
    assert preset_of(["ringlight-paper", "ringlight-ring"], METHODS["ringlight-ring"]) == "ringlight-ring"
    assert preset_of(["3dgs", "ringlight-paper", "--out", "ringlight-ring"], PAPER) == "ringlight-paper"


def test_changed_settings_keep_the_name():
    changed = dataclasses.replace(PAPER, steps=10, densify=dataclasses.replace(PAPER.densify, begin=3))
    assert preset_of(["scene", "ringlight-paper", "--steps", "10"], changed) == "ringlight-paper"
