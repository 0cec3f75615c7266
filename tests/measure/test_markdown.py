"""Texts of strangers stand in Markdown as they are: markdown-it is the judge, but for links that GitHub alone makes."""

import pytest
from hypothesis import given
from hypothesis import strategies as st
from markdown_it import MarkdownIt
from samples import sample_report

from ringlight.core.visible_text import visible
from ringlight.measure.markdown import markdown_line, markdown_row, markdown_text
from ringlight.measure.method_cells import MethodCells
from ringlight.measure.method_table import MethodTable
from ringlight.measure.study_table import Label, StudyTable, study_rows
from ringlight.measure.table import ResultsTable

TRICKS = "\\`*_[]()<>&~|#!$:/-+=.)1 aw\n\u202e"


def shown(markdown: str) -> list[str]:
    """The text of each paragraph and cell, where nothing but text may be in them, and nothing else on the page."""
    tokens = MarkdownIt("gfm-like", {"linkify": False}).parse(markdown)
    inline = [token for token in tokens if token.type == "inline"]
    for token in inline:
        assert {child.type for child in token.children or []} <= {"text", "text_special"}, markdown
    assert {token.type for token in tokens} <= BLOCKS, markdown
    return ["".join(child.content for child in token.children or []) for token in inline]


BLOCKS = {"inline", "paragraph_open", "paragraph_close"} | {
    f"{part}_{end}" for part in ("table", "thead", "tbody", "tr", "th", "td") for end in ("open", "close")
}


@given(st.text(st.sampled_from(TRICKS) | st.characters(codec="utf-8"), min_size=1).filter(str.strip))
def test_a_line_shows_its_text(text: str) -> None:
    assert [line.strip() for line in shown(markdown_line(text))] == [visible(text.strip()).strip()]


@given(st.text(st.sampled_from(TRICKS)), st.text(st.sampled_from(TRICKS), min_size=1).filter(str.strip))
def test_a_cell_shows_its_text(first: str, second: str) -> None:
    heads = [markdown_row(["a", "b"]), markdown_row([":--", "--:"])]
    cells = shown("\n".join([*heads, markdown_row([markdown_text(first), markdown_text(second)])]))
    assert [cell.strip() for cell in cells[2:]] == [visible(first).strip(), visible(second).strip()]


@pytest.mark.parametrize("name", ["chair_400", "0.5%", "r_0.png: 22.5 dB!", ".ply"])
def test_what_styles_nothing_stays_as_it_is(name: str) -> None:
    assert markdown_line(name) == name


@pytest.mark.parametrize(
    ("address", "written"),
    [("https://x.y/a", r"https\://x.y/a"), ("ftp://x.y", r"ftp\://x.y"), ("see www.x.y", r"see www\.x.y")],
)
def test_an_address_is_no_link(address: str, written: str) -> None:
    assert markdown_text(address) == written


@pytest.mark.parametrize("name", ["[a](http://b)", "<img src=x>", "![a](b)", "`a`", "**a**", "a|b"])
def test_a_table_of_results_shows_names_of_strangers(name: str) -> None:
    runs = [(name, sample_report(scene=name, noun=name, planned=7, iterations=3)), ("plain", sample_report())]
    table = ResultsTable(runs).markdown()
    tokens = MarkdownIt("gfm-like", {"linkify": False}).parse(table)
    children = [child for token in tokens for child in token.children or []]
    assert {child.type for child in children} <= {"text", "text_special", "strong_open", "strong_close"}
    texts = ["".join(c.content for c in token.children or []) for token in tokens if token.type == "inline"]
    assert name in texts
    assert f"{name} stopped at step 3 of 7." in texts


def test_tables_of_studies_and_of_methods_show_names_of_strangers() -> None:
    name = "[a](http://b) <i>|"
    study = StudyTable(study_rows((Label(name, name),), {name: {name: {0: sample_report()}}}))
    methods = MethodTable(MethodCells((name,), (name,), (0,), {(name, name): {0: sample_report()}}, (name,)))
    for markdown in (study.markdown(), methods.markdown()):
        tokens = MarkdownIt("gfm-like", {"linkify": False}).parse(markdown)
        children = [child for token in tokens for child in token.children or []]
        assert not {child.type for child in children} & {"link_open", "image", "html_inline"}
        texts = ["".join(c.content for c in token.children or []) for token in tokens if token.type == "inline"]
        assert name in texts
