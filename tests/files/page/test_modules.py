"""Joined modules: everything once and in order, and what cannot be joined is refused when the page is built."""

import pytest

from ringlight.files.page.modules import joined, slim

TWO = {
    "main.js": 'import { twice, Counter } from "./numbers.js";\n\nconst value = twice(3);\n',
    "numbers.js": "export function twice(x) {\n  return 2 * x;\n}\nexport class Counter {}\nconst hidden = 1;\n",
}


def test_a_module_stands_before_those_that_import_it_and_keeps_its_own_names() -> None:
    script = joined(TWO, "main.js")
    assert script.index("$numbers = ") < script.index("$main = ")
    assert "const { twice, Counter } = $numbers;" in script
    assert "return { Counter, twice };" in script
    assert "import" not in script
    assert "export" not in script


def test_a_module_that_two_import_is_there_once() -> None:
    sources = TWO | {
        "other.js": 'import { twice } from "./numbers.js";\nexport const four = twice(2);\n',
        "main.js": 'import { four } from "./other.js";\nimport { twice } from "./numbers.js";\ntwice(four);\n',
    }
    assert joined(sources, "main.js").count("$numbers = ") == 1


def test_a_circle_is_refused() -> None:
    sources = {
        "a.js": 'import { b } from "./b.js";\nexport const a = b;\n',
        "b.js": 'import { a } from "./a.js";\nexport const b = a;\n',
    }
    with pytest.raises(ValueError, match=r"circle: a\.js -> b\.js -> a\.js"):
        joined(sources, "a.js")


@pytest.mark.parametrize(
    ("source", "reason"),
    [
        ('import { thrice } from "./numbers.js";\n', "imports thrice"),
        ('import * as all from "./numbers.js";\n', "not understood"),
        ("export default 3;\n", "not understood"),
    ],
)
def test_what_is_not_understood_is_refused(source: str, reason: str) -> None:
    with pytest.raises(ValueError, match=reason):
        joined(TWO | {"main.js": source}, "main.js")


def test_slim_drops_lines_of_comment_alone() -> None:
    assert slim("// why\n  a = 1; // stays\n\n\tb = 2;\n") == "a = 1; // stays\nb = 2;"
