"""A browser is driven through its pipe, and ends."""

import pytest

from ringlight.bench import browser as browsers
from ringlight.errors import BackendError


@pytest.fixture
def program() -> str:
    try:
        return browsers.find_browser()
    except BackendError as error:
        pytest.skip(str(error))


def test_pages_open_and_tell_values(program: str) -> None:
    with browsers.opened_browser(program) as browser:
        browser.open("about:blank", 123, 45)
        assert browser.value("[innerWidth, innerHeight]") == [123, 45]
        assert browser.value("new Promise((resolve) => setTimeout(() => resolve('late'), 20))") == "late"
        assert browser.value("'é'.repeat(200000)") == "é" * 200_000, "longer than a pipe holds"
        with pytest.raises(BackendError, match="boom"):
            browser.value("(() => { throw new Error('boom'); })()")
        browser.open("data:text/html,<p>x", 50, 60, "window.before = 7")
        assert browser.value("[innerWidth, window.before]") == [50, 7]


def test_an_error_inside_ends_the_browser_too(program: str) -> None:
    def look() -> None:
        with browsers.opened_browser(program) as browser:
            browser.open("about:blank", 10, 10)
            raise ValueError("ours")

    with pytest.raises(ValueError, match="ours"):
        look()


def test_a_browser_that_dies_is_one_sentence(program: str) -> None:
    with browsers.opened_browser(program) as browser, pytest.raises(BackendError, match="has ended"):
        browser._ask("Browser.crash")
