"""Why stored reports lack a LPIPS, told as it is now: the weights may have come since the runs were measured."""

from collections.abc import Sequence
from typing import get_args

from ringlight.measure.lpips import Net, weights_damaged, weights_missing, weights_status
from ringlight.measure.report import Report


def stored_lpips_notes(reports: Sequence[Report]) -> tuple[str, ...]:
    """One sentence for each net whose weights were missing or damaged when runs were measured, then all other
    reasons."""
    notes, rests = [], [report.lpips_note for report in reports]
    for net in get_args(Net):
        sentences = (weights_missing(net), weights_damaged(net))
        lacking = sum(any(sentence in rest for sentence in sentences) for rest in rests)
        if lacking:
            notes.append(_remedy(net, "these runs" if lacking == len(reports) else "some of these runs"))
            for sentence in sentences:
                rests = [rest.replace(sentence, "").strip() for rest in rests]
    return (*notes, *sorted(set(filter(None, rests))))


def _remedy(net: Net, runs: str) -> str:
    # eval measures alex unless it is told otherwise.
    command = "ringlight eval RUN" if net == "alex" else f"ringlight eval RUN --lpips {net}"
    first = " after 'ringlight fetch-lpips'" if weights_status(net) else ""
    return f"LPIPS with {net} was not measured in {runs}; measure it with '{command}'{first}."
