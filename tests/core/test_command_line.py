"""What is offered to copy is what a shell gives the program."""

import os
import subprocess

from hypothesis import example, given, settings
from hypothesis import strategies as st

from ringlight.core.command_line import command

NAMES = st.text(st.characters(exclude_characters="\0", exclude_categories=["Cs"]), max_size=20)


@settings(max_examples=40)
@given(NAMES)
@example("my photos")
@example("it's \\ \x1b[31m red\n")
@example("ü 📷 \u202e")
@example(os.fsdecode(b"caf\xe9"))
def test_a_shell_reads_the_name_that_was_meant(name: str):
    line = command("render", name)
    assert line.isprintable()
    words = subprocess.run(["bash", "-c", f"printf '%s\\0' {line}"], capture_output=True, check=True).stdout
    assert words == b"ringlight\0render\0" + os.fsencode(name) + b"\0"
