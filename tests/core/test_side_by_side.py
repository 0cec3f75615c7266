"""Pieces of torch's work: in order, without a graph, one torch thread each, whoever does them."""

import threading

import pytest
import torch

from ringlight import _kernels
from ringlight.core.side_by_side import side_by_side

CPU = torch.device("cpu")
pytestmark = pytest.mark.usefixtures("all_cores_afterwards")


@pytest.mark.parametrize("threads", [1, 2, 5])
def test_what_they_return_comes_in_their_order(threads: int):
    _kernels.set_threads(threads)
    assert side_by_side([lambda k=k: k * k for k in range(50)], CPU) == [k * k for k in range(50)]
    assert side_by_side([], CPU) == []


@pytest.mark.parametrize("threads", [1, 3])
def test_they_record_no_graph(threads: int):
    _kernels.set_threads(threads)
    leaf = torch.ones(3, requires_grad=True)
    assert not any(found.requires_grad for found in side_by_side([lambda: leaf * 2] * 4, CPU))
    assert torch.is_grad_enabled()


def test_threads_share_the_work_and_torch_has_as_many_in_each_as_elsewhere():
    _kernels.set_threads(3)
    together = threading.Barrier(3, timeout=20)

    def piece() -> tuple[int, int]:
        together.wait()  # so that one thread cannot do it all
        return threading.get_ident(), torch.get_num_threads()

    found = side_by_side([piece] * 3, CPU)
    assert len({thread for thread, _ in found}) == 3
    assert {count for _, count in found} == {torch.get_num_threads()}


def test_on_another_device_the_caller_does_all():
    _kernels.set_threads(3)
    assert side_by_side([threading.get_ident] * 6, torch.device("meta")) == [threading.get_ident()] * 6


@pytest.mark.parametrize("threads", [1, 2])
def test_what_one_raises_is_raised(threads: int):
    _kernels.set_threads(threads)

    def fails() -> None:
        raise MemoryError("not enough")

    with pytest.raises(MemoryError, match="not enough"):
        side_by_side([lambda: None, fails, lambda: None], CPU)
