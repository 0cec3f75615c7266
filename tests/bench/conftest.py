import pytest

from ringlight.bench.record import Circumstances
from ringlight.measure.machine import machine


@pytest.fixture
def circumstances():
    return Circumstances("0", None, "2000-01-01", machine(), 1.0, 1.0, 1.0, None)
