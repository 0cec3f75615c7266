"""What a view's card says of its place among the views."""

from dataclasses import replace
from pathlib import Path

import pytest
from samples import sample_report

from ringlight.pages.markup import Html
from ringlight.pages.report.gathered import GatheredRun
from ringlight.pages.report.groups import Member
from ringlight.pages.report.sections import _card
from ringlight.pages.report.views import RunPicture, ViewShown

RUN = GatheredRun(Path("run"), replace(sample_report(), images=()), None, (), ())
PICTURE = RunPicture(Member("3dgs", 0, RUN), 21.5, "data:,a", "data:,b")


@pytest.mark.parametrize(
    ("rank", "of", "words"),
    [(0, 1, "the only view"), (0, 2, "worst view"), (1, 2, "best view"), (4, 9, "5 of 9"), (8, 9, "best view")],
)
def test_the_place_of_a_view(rank: int, of: int, words: str) -> None:
    view = ViewShown("r_0", rank, of, 30, 20, "data:,c", (PICTURE,))
    assert f"{words}, 21.50 dB" in str(_card(view, "key", Html("")))
