"""Numbers with their noun: one is no plural, thousands are set apart."""

import pytest

from ringlight.core.words import counted, numbered
from ringlight.models.contract import Count


@pytest.mark.parametrize(("number", "said"), [(0, "0 steps"), (1, "1 step"), (2, "2 steps"), (3000, "3,000 steps")])
def test_a_number_with_its_noun(number: int, said: str) -> None:
    assert counted(number, "step") == numbered(number, "steps") == said


def test_what_a_model_is_made_of() -> None:
    assert [str(Count(number, "Gaussians")) for number in (1, 59125)] == ["1 Gaussian", "59,125 Gaussians"]
