"""Many runs over places that fail, die and are told to stop: each run ends in exactly one way."""

from collections import Counter
from typing import Any

from hypothesis import given
from hypothesis import strategies as st

from ringlight.errors import BackendError, RunError
from ringlight.runs.many import MOST_LOSSES, STOPPED, Happened, Waiting, run_many


class Scripted:
    """A place whose runs end as their script says, call after call: "ok", "fail" or "lost"; once it was stopped, as
    processes do that saved, but for those that fail."""

    def __init__(self, jobs: int, scripts: dict[str, list[str]]):
        self.jobs, self.scripts = jobs, {name: list(script) for name, script in scripts.items()}
        self.under_way: list[str] = []
        self.begun: Counter[str] = Counter()
        self.most = 0
        self.stopped = self.closed = False

    def is_free(self) -> bool:
        return len(self.under_way) < self.jobs

    def begin(self, name: str, order: dict[str, Any]) -> None:
        assert self.is_free()
        assert not self.stopped
        assert order == {"name": name}
        self.under_way.append(name)
        self.begun[name] += 1
        self.most = max(self.most, len(self.under_way))

    def events(self, seconds: float) -> list[Happened]:
        if not self.under_way:
            return []
        name = self.under_way.pop(0)
        end = self.scripts[name].pop(0) if self.scripts[name] else "ok"
        if end == "lost":
            return [Happened("lost", name, "worker w is gone")]
        well = f"{STOPPED} after step 3 and saved" if self.stopped else None
        return [Happened("ended", name, "the disk is full" if end == "fail" else well)]

    def stop(self) -> None:
        self.stopped = True

    def close(self) -> None:
        self.closed = True


ENDS = st.lists(st.sampled_from(["ok", "fail", "lost"]), max_size=5)


@given(scripts=st.dictionaries(st.text("abc", min_size=1, max_size=3), ENDS, max_size=8), jobs=st.integers(1, 4))
def test_each_run_ends_once_and_none_stops_another(scripts: dict[str, list[str]], jobs: int) -> None:
    place = Scripted(jobs, scripts)
    heard: list[Happened] = []
    failed = run_many({name: {"name": name} for name in scripts}, place, heard.append, lambda: 0)
    assert place.closed
    assert not place.under_way
    assert place.most <= jobs
    for name, script in scripts.items():
        ends = [*script, *["ok"] * MOST_LOSSES]
        last = next((at for at, end in enumerate(ends) if end != "lost"), MOST_LOSSES)
        if last >= MOST_LOSSES:
            assert place.begun[name] == MOST_LOSSES
            assert "workers died" in failed[name]
            of_run = [event.kind for event in heard if event.name == name and event.kind != "began"]
            assert of_run == [*["lost"] * (MOST_LOSSES - 1), "ended"], "the last loss gives it up"
        else:
            assert place.begun[name] == last + 1
            assert (name in failed) == (ends[last] == "fail")


@given(after=st.integers(0, 6), full=st.sets(st.sampled_from("abcdef")))
def test_once_it_is_stopped_nothing_begins_and_only_what_cannot_save_counts_as_failed(
    after: int, full: set[str]
) -> None:
    place = Scripted(2, {name: ["fail"] if name in full else [] for name in "abcdef"})
    heard: list[Happened] = []
    failed = run_many({n: {"name": n} for n in "abcdef"}, place, heard.append, lambda: int(len(heard) >= after))
    begun_before = [event.name for event in heard[:after] if event.kind == "began"]
    assert set(place.begun) <= {*begun_before, *list("abcdef")[: len(begun_before) + 1]}
    assert set(failed) == full & set(place.begun)
    assert {event.name for event in heard if event.reason == "the disk is full"} == set(failed)
    assert place.closed


@given(
    waits=st.lists(st.integers(0, 7), min_size=1, max_size=8),
    fails=st.sets(st.integers(0, 7)),
    jobs=st.integers(1, 4),
)
def test_a_run_begins_after_that_which_it_waits_for_and_not_if_that_failed(
    waits: list[int], fails: set[int], jobs: int
) -> None:
    """Run n waits for run waits[n] of those before it; one that waits for itself, or a later one, waits for none."""
    place = Scripted(jobs, {str(n): ["fail"] if n in fails else [] for n in range(len(waits))})
    heard: list[Happened] = []

    def order(name: str, on: str) -> Waiting:
        def made() -> dict[str, Any]:
            assert Happened("ended", on) in heard, "the order is made when the other is finished"
            return {"name": name}

        return Waiting(on, made)

    orders = {str(n): order(str(n), str(on)) if on < n else {"name": str(n)} for n, on in enumerate(waits)}
    failed = run_many(orders, place, heard.append, lambda: 0)
    expected: dict[str, bool] = {}
    for n, on in enumerate(waits):
        expected[str(n)] = n in fails or (on < n and expected[str(on)])
    assert {name for name, fell in expected.items() if fell} == set(failed)
    assert Counter(event.name for event in heard if event.kind == "ended") == Counter(list(orders))


@given(scripts=st.dictionaries(st.text("abc", min_size=1, max_size=3), ENDS, max_size=8), after=st.integers(0, 8))
def test_what_a_place_leaves_that_is_gone_has_its_reason(scripts: dict[str, list[str]], after: int) -> None:
    class Mortal(Scripted):
        def events(self, seconds: float) -> list[Happened]:
            if len(heard) >= after:
                raise BackendError("the scheduler is gone")
            return super().events(seconds)

    place, heard = Mortal(2, scripts), list[Happened]()
    failed = run_many({name: {"name": name} for name in scripts}, place, heard.append, lambda: 0)
    assert place.closed
    finished = {event.name for event in heard if event.kind == "ended" and event.reason is None}
    assert finished | failed.keys() == scripts.keys()
    assert not finished & failed.keys()
    told = [event.reason for event in heard if event.kind == "told"]
    assert told == ["the scheduler is gone"] * ("the scheduler is gone" in failed.values())


def test_an_order_that_cannot_be_made_is_a_reason_and_no_error() -> None:
    def made() -> dict[str, Any]:
        raise RunError("the report of a is damaged")

    place = Scripted(1, {"b": [], "c": []})
    failed = run_many({"b": Waiting("a", made), "c": {"name": "c"}}, place, lambda event: None, lambda: 0)
    assert failed == {"b": "the report of a is damaged"}
    assert place.begun == {"c": 1}
