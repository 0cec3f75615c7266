"""Rounds take turns, stages run in order, preparation is off the clock."""

from ringlight.bench.timing import TOTAL, WARMUP_ROUNDS, Budget, Contestant, interleaved


def test_contestants_take_turns_and_stages_keep_their_order():
    calls = []
    contestants = {
        "a": Contestant({"one": lambda: calls.append("a1"), "two": lambda: calls.append("a2")}),
        "b": Contestant({"one": lambda: calls.append("b1")}, prepare=lambda: calls.append("prepare b")),
    }
    interleaved(contestants, Budget(rounds=3, seconds=60.0))
    a, b = ["a1", "a2"], ["prepare b", "b1"]
    assert calls == (a + b) * WARMUP_ROUNDS + (2 * a + 2 * b) * 3  # each turn runs twice


def test_total_is_there_and_no_less_than_its_stages():
    timings = interleaved({"a": Contestant({"one": lambda: sum(range(1000)), "two": list})}, Budget(3, 60.0))["a"]
    assert set(timings) == {"one", "two", TOTAL}
    assert timings[TOTAL].best_ms >= timings["one"].best_ms


def test_one_round_is_timed_however_small_the_budget():
    calls = []
    timings = interleaved({"a": Contestant({"one": lambda: calls.append(0)})}, Budget(rounds=5, seconds=0.0))
    assert len(calls) == WARMUP_ROUNDS + 2
    assert timings["a"]["one"].wall_ms >= 0
