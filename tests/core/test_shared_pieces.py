"""Pieces of torch's work: in order, without a graph, with the caller's switches, whoever does them."""

import os
import signal
import threading
from functools import partial

import pytest
import torch

from ringlight import _kernels
from ringlight.core import shared_pieces
from ringlight.core.shared_pieces import both, do_all, each_of

CPU = torch.device("cpu")
pytestmark = pytest.mark.usefixtures("all_cores_afterwards")


@pytest.fixture(autouse=True)
def _pool_of_ones_own():
    shared_pieces._pool.cache_clear()
    yield
    shared_pieces._pool.cache_clear()


@pytest.mark.parametrize("threads", [1, 2, 5])
def test_what_they_return_comes_in_their_order(threads: int):
    _kernels.set_threads(threads)
    assert list(each_of([lambda k=k: k * k for k in range(50)], CPU)) == [k * k for k in range(50)]
    assert list(each_of([], CPU)) == []


@pytest.mark.parametrize("threads", [1, 3])
def test_they_record_no_graph(threads: int):
    _kernels.set_threads(threads)
    leaf = torch.ones(3, requires_grad=True)
    assert not any(found.requires_grad for found in each_of([lambda: leaf * 2] * 4, CPU))
    assert torch.is_grad_enabled()


@pytest.mark.parametrize("threads", [1, 3])
@pytest.mark.parametrize("inference", [False, True])
def test_they_may_write_to_what_the_caller_made(threads: int, inference: bool):
    _kernels.set_threads(threads)
    with torch.inference_mode(inference):
        found = torch.zeros(4)
        do_all([lambda k=k: found[k : k + 1].fill_(k) for k in range(4)], CPU)
    assert found.tolist() == [0, 1, 2, 3]
    assert found.is_inference() is inference


def test_threads_share_the_work_and_each_of_them_has_as_many_of_torch_as_the_caller(all_torch_threads_afterwards):
    _kernels.set_threads(3)
    for of_torch in (1, 2):  # a thread keeps what it began with
        torch.set_num_threads(of_torch)
        together = threading.Barrier(3, timeout=20)

        def piece(together=together) -> tuple[int, int]:
            together.wait()  # so that one thread cannot do it all
            return threading.get_ident(), torch.get_num_threads()

        found = list(each_of([piece] * 3, CPU))
        assert len({thread for thread, _ in found}) == 3
        assert {count for _, count in found} == {of_torch}


@pytest.fixture
def all_torch_threads_afterwards():
    before = torch.get_num_threads()
    yield
    torch.set_num_threads(before)


def test_no_more_are_begun_than_may_be_in_memory():
    _kernels.set_threads(2)
    begun = []
    for done, _ in enumerate(each_of([lambda k=k: begun.append(k) for k in range(30)], CPU)):
        assert len(begun) <= done + 3


def test_on_another_device_the_caller_does_all():
    _kernels.set_threads(3)
    assert list(each_of([threading.get_ident] * 6, torch.device("meta"))) == [threading.get_ident()] * 6


def fails() -> None:
    raise MemoryError("not enough")


def take_long(running: list[bool]) -> None:
    running.append(True)
    threading.Event().wait(0.2)
    running.pop()


@pytest.mark.parametrize("threads", [1, 2])
def test_what_one_raises_is_raised_and_none_goes_on(threads: int):
    _kernels.set_threads(threads)
    running: list[bool] = []
    takes_long = partial(take_long, running)
    with pytest.raises(MemoryError, match="not enough"):
        do_all([takes_long, fails, takes_long, takes_long], CPU)
    assert not running


def test_where_the_system_gives_no_threads_the_caller_does_all(monkeypatch: pytest.MonkeyPatch):
    _kernels.set_threads(3)
    start, started = threading.Thread.start, []

    def second_fails(thread: threading.Thread) -> None:
        if started:
            raise RuntimeError("can't start new thread")
        started.append(thread)
        start(thread)

    monkeypatch.setattr(threading.Thread, "start", second_fails)
    assert list(each_of([threading.get_ident] * 6, CPU)) == [threading.get_ident()] * 6
    assert started


@pytest.mark.skipif(not hasattr(os, "fork"), reason="no fork here")
@pytest.mark.filterwarnings("ignore:.*fork:DeprecationWarning")
def test_a_forked_child_has_threads_of_its_own():
    _kernels.set_threads(2)
    pieces = [lambda: torch.ones(3).sum().item()] * 5
    assert list(each_of(pieces, CPU)) == [3.0] * 5
    child = os.fork()
    if not child:
        signal.alarm(20)
        os._exit(0 if list(each_of(pieces, CPU)) == [3.0] * 5 else 1)
    assert os.waitstatus_to_exitcode(os.waitpid(child, 0)[1]) == 0


@pytest.mark.parametrize("threads", [1, 2, 5])
def test_both_return_what_they_find_and_each_may_ask_for_pieces(threads: int):
    _kernels.set_threads(threads)
    one, other = both(*(lambda n=n: list(each_of([lambda k=k: n * k for k in range(20)], CPU)) for n in (2, 3)), CPU)
    assert one == [2 * k for k in range(20)]
    assert other == [3 * k for k in range(20)]


def test_two_are_at_once_where_there_are_threads():
    _kernels.set_threads(2)
    together = threading.Barrier(2, timeout=20)
    found = both(
        lambda: (together.wait(), threading.get_ident()), lambda: (together.wait(), threading.get_ident()), CPU
    )
    assert len({thread for _, thread in found}) == 2
    assert found[0][1] == threading.get_ident()


@pytest.mark.parametrize(("threads", "device"), [(1, CPU), (3, torch.device("meta"))])
def test_the_caller_does_one_after_the_other_with_one_thread_or_elsewhere(threads: int, device: torch.device):
    _kernels.set_threads(threads)
    order = []
    both(lambda: order.append((0, threading.get_ident())), lambda: order.append((1, threading.get_ident())), device)
    assert order == [(0, threading.get_ident()), (1, threading.get_ident())]


@pytest.mark.parametrize("threads", [1, 2])
@pytest.mark.parametrize("first", [False, True])
def test_what_one_of_two_raises_is_raised_when_the_other_has_ended(threads: int, first: bool):
    _kernels.set_threads(threads)
    running: list[bool] = []
    takes_long = partial(take_long, running)
    pair = (fails, takes_long) if first else (takes_long, fails)
    with pytest.raises(MemoryError, match="not enough"):
        both(*pair, CPU)
    assert not running


@pytest.mark.parametrize("threads", [1, 2])
def test_both_have_the_callers_inference_mode(threads: int):
    _kernels.set_threads(threads)
    with torch.inference_mode():
        assert both(torch.is_inference_mode_enabled, torch.is_inference_mode_enabled, CPU) == (True, True)
    assert both(torch.is_inference_mode_enabled, torch.is_inference_mode_enabled, CPU) == (False, False)
