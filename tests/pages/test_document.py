"""One file of template, style and script."""

import pytest
from parsed import Parsed, assert_loads_nothing
from test_markup import HOSTILE

from ringlight.pages.document import document
from ringlight.pages.markup import element
from ringlight.pages.report.build import SOURCES


@pytest.mark.parametrize("text", HOSTILE)
def test_the_policy_names_what_is_in_the_page(text: str) -> None:
    page = Parsed(document(SOURCES, text, element("p", text)))
    assert_loads_nothing(page)
    assert len(page.all("script")) == 1
    assert len(page.all("p")) == 1


def test_a_style_that_would_end_early_is_refused(tmp_path, monkeypatch) -> None:
    folder = tmp_path / "hostile_page"
    folder.mkdir()
    for file, text in (("__init__.py", ""), ("page.html", "{{style}}"), ("page.css", "</STYLE>"), ("page.js", "")):
        (folder / file).write_text(text)
    monkeypatch.syspath_prepend(tmp_path)
    with pytest.raises(ValueError, match=r"page\.css"):
        document("hostile_page", "", element("p"))
