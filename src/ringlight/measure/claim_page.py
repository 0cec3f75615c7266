"""The paper's claims one by one, with ours beside them, as a section of a Markdown page."""

from collections import Counter
from collections.abc import Iterator, Sequence
from textwrap import wrap

from ringlight.errors import OutputError
from ringlight.measure.claim_records import Record
from ringlight.measure.claims import Paper, claims_of
from ringlight.measure.markdown import markdown_row
from ringlight.measure.verdicts import RATIOS, RULE, Judged, Verdict, judged

BEGIN = "<!-- 'ringlight reproduce' writes from here -->"
END = "<!-- to here -->"

HEADINGS = {"psnr": "PSNR, dB", "ssim": "SSIM", "lpips": "LPIPS", "megabytes": "MB", "fps": "FPS", "minutes": "minutes"}
DIGITS = {"psnr": 2, "ssim": 3, "lpips": 3}
WIDTH = 120
"""Of our documents."""

MARKS = {"reproduced": "✓", "not reproduced": "✗", "cannot be tested": "○"}


def all_judged(paper: Paper, records: Sequence[Record]) -> tuple[Judged, ...]:
    """Every claim of every table, in the paper's order."""
    return tuple(judged(claim, paper, records) for table in paper.tables for claim in claims_of(table))


def claim_section(paper: Paper, found: Sequence[Judged], command: str) -> str:
    """The section, markers included; ``command`` is the one that writes it."""
    lines = [
        BEGIN,
        "",
        "## Claim by claim",
        "",
        f"Written by `{command}`, from {paper.paper}.",
        "",
        *_wrapped(RULE),
        "",
    ]
    lines += [
        "A cell is the paper's difference → ours, with ✓ (reproduced), ✗ (not reproduced) or ○ (cannot be tested).",
        "Ours of LPIPS are by the network that both rows have on most scenes; minutes are those of one core.",
        "",
    ]
    for name, data in paper.data_sets.items():
        lines += _wrapped(f"* {name}: {', '.join(data.scenes)}; {data.about}.", "  ")
    lines += ["", *_tally(found)]
    for table in paper.tables:
        of_table = [judgement for judgement in found if judgement.claim.table is table]
        lines += ["", f"### {table.where[0].upper()}{table.where[1:]}: {table.of} beside the others", ""]
        lines += [*_table(of_table), "", f"`{table.command.format(subject='METHOD')}`"]
    lines += ["", "### Figures", "", markdown_row(("figure", "what it says", "why no number decides", "command"))]
    lines += [markdown_row((":--",) * 4)]
    lines += [markdown_row((f.where, f.says, f"cannot be tested: {f.why}", f"`{f.command}`")) for f in paper.figures]
    return "\n".join([*lines, "", END]) + "\n"


def filled(page: str, section: str, name: str) -> str:
    """The page with the section in place of the earlier one, or at its end. Raises OutputError where only one of its
    marks is there."""
    if (BEGIN in page) != (END in page):
        raise OutputError(
            f"{name}: has only one of the two marks around the section; put the other back, or take it out"
        )
    if BEGIN not in page:
        return page.rstrip("\n") + "\n\n" + section
    before, _, rest = page.partition(BEGIN)
    _, _, after = rest.partition(END)
    return before + section.rstrip("\n") + after


def _tally(found: Sequence[Judged]) -> Iterator[str]:
    counted: Counter[str] = Counter(verdict.word for judgement in found for verdict in judgement.verdicts.values())
    yield "Numbers: " + ", ".join(f"{counted[word]} {word}" for word in MARKS) + "."


def _table(found: Sequence[Judged]) -> Iterator[str]:
    measures = list(dict.fromkeys(name for judgement in found for name in judgement.verdicts))
    heads = [HEADINGS[name] + (", ratio" if name in RATIOS else "") for name in measures]
    yield markdown_row(("data set", "beside", *heads, "ours from"))
    yield markdown_row((":--", ":--", *["--:"] * len(heads), ":--"))
    for judgement in found:
        cells = [_cell(name, judgement.verdicts.get(name)) for name in measures]
        yield markdown_row((judgement.claim.data_set, judgement.claim.other.name, *cells, judgement.because))


def _cell(name: str, verdict: Verdict | None) -> str:
    if verdict is None:
        return ""
    numbers = [_number(name, value) for value in (verdict.paper, verdict.ours) if value is not None]
    return f"{' → '.join(numbers)} {MARKS[verdict.word]}"


def _number(name: str, value: float) -> str:
    return f"{value:.2f}" if name in RATIOS else f"{value:+.{DIGITS[name]}f}"


def _wrapped(text: str, indent: str = "") -> Iterator[str]:
    yield from wrap(text, WIDTH, subsequent_indent=indent, break_long_words=False, break_on_hyphens=False)
