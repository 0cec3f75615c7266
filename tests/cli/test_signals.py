"""Signals that end a command: kept, heard once, and given back."""

import os
import signal

import pytest

from ringlight.cli.signals import STOPPING, kept_signals, signals_to


@pytest.fixture(autouse=True)
def _as_a_shell_in_front_starts_it():
    before = {number: signal.signal(number, signal.SIG_DFL) for number in STOPPING}
    yield
    for number, handler in before.items():
        signal.signal(number, handler)


@pytest.mark.parametrize("number", STOPPING)
def test_a_signal_leaves_its_number_and_its_handler_comes_back(number: int):
    heard = []
    with kept_signals(lambda number, before: heard.append((number, list(before)))) as kept:
        os.kill(os.getpid(), number)
        os.kill(os.getpid(), number)
    assert kept == [number, number]
    assert heard == [(number, []), (number, [number])]
    assert signal.getsignal(number) is signal.SIG_DFL


def test_one_that_comes_while_another_is_told_of_is_the_second():
    heard = []

    def hear(number: int, before: list[int]) -> None:
        heard.append(list(before))
        if not before:
            os.kill(os.getpid(), number)

    with kept_signals(hear) as kept:
        os.kill(os.getpid(), signal.SIGTERM)
    assert heard == [[], [signal.SIGTERM]]
    assert kept == [signal.SIGTERM] * 2


def test_what_the_parent_ignored_stays_ignored():
    signal.signal(signal.SIGHUP, signal.SIG_IGN)
    with kept_signals() as kept:
        os.kill(os.getpid(), signal.SIGHUP)
    assert kept == []
    assert signal.getsignal(signal.SIGHUP) is signal.SIG_IGN


def test_handlers_come_back_where_one_raises():
    def stop(number: int, frame: object) -> None:
        raise KeyboardInterrupt(number)

    with pytest.raises(KeyboardInterrupt), signals_to(stop):
        os.kill(os.getpid(), signal.SIGTERM)
    assert signal.getsignal(signal.SIGTERM) is signal.SIG_DFL
