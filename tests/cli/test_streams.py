"""Nobody reads what a command says: it goes on all the same, and exits by what it did."""

import io
import os
import pty
import shutil
import signal
import subprocess
import sys
from pathlib import Path

import pytest
from cli_session import QUICK
from hypothesis import given
from hypothesis import strategies as st
from rich.console import Console
from rich.file_proxy import FileProxy
from rich.progress import Progress

from ringlight.cli.signals import signals_to
from ringlight.cli.streams import Lasting, past_bars, printable

RINGLIGHT = [sys.executable, "-m", "ringlight"]
TALKATIVE = tuple(word for word in QUICK if word != "--quiet")


def closed_pipe() -> Lasting:
    """A stream into a pipe that nobody reads any more."""
    reader, writer = os.pipe()
    os.close(reader)
    return Lasting(os.fdopen(writer, "w", buffering=1))


def test_a_stream_without_a_reader_takes_what_is_written():
    stream = closed_pipe()
    assert stream.write("gone\n") == 5
    stream.write("gone too\n")
    stream.writelines(["and\n", "these\n"])
    stream.flush()
    stream.close()


def test_what_waits_in_the_buffer_is_lost_without_an_error():
    reader, writer = os.pipe()
    stream = Lasting(os.fdopen(writer, "w"))
    stream.write("waits")
    os.close(reader)
    stream.flush()
    stream.close()


def test_a_full_disk_is_still_told():
    with Path("/dev/full").open("w", buffering=1) as full:
        with pytest.raises(OSError, match="No space left"):
            Lasting(full).write("results\n")
        Lasting(full, essential=False).write("step 5\n")


def test_a_terminal_that_was_closed_is_no_reason_to_end():
    """Where SIGHUP is ignored, as of a job that was disowned, writing is what fails."""
    ours, theirs = pty.openpty()
    stream = Lasting(os.fdopen(theirs, "w", buffering=1))
    stream.write("read by somebody\n")
    os.close(ours)
    stream.write("by nobody\n")
    stream.flush()
    stream.close()


class Interrupted(io.RawIOBase):
    """Takes all, but a signal comes before the first."""

    taken = b""
    is_interrupted = False

    def writable(self) -> bool:
        return True

    def write(self, written) -> int:
        if not self.is_interrupted:
            self.is_interrupted = True
            signal.raise_signal(signal.SIGTERM)
        self.taken += bytes(written)
        return len(written)


@pytest.mark.parametrize("line_buffering", [True, False])
def test_a_signal_within_a_call_is_told_after_it(line_buffering: bool):
    """A terminal that is slow, or was paused, keeps a write or a flush waiting, and the impatient user presses
    Ctrl-C."""
    raw = Interrupted()
    stream = Lasting(io.TextIOWrapper(io.BufferedWriter(raw), "utf-8", line_buffering=line_buffering))
    with signals_to(lambda number, frame: print("then saving", file=stream, flush=True)):
        print("step 1", file=stream, flush=True)
    assert raw.taken == b"step 1\nthen saving\n"


def test_a_handler_writes_past_a_bar():
    """Whose locks it must not wait for: a thread that draws the bar may hold one and wait for another that the command
    holds."""
    stream = Lasting(io.TextIOWrapper(io.BytesIO(), "utf-8", write_through=True))
    console = Console(file=stream.drawing(), force_terminal=True)
    assert past_bars(FileProxy(console, stream)) is stream
    assert past_bars(stream) is stream


def test_a_write_that_a_signal_ends_keeps_the_stream():
    raw = Interrupted()
    stream = Lasting(io.TextIOWrapper(io.BufferedWriter(raw), "utf-8", write_through=True))

    def interrupt(number, frame):
        raw.taken = b"(cut short) "
        raise KeyboardInterrupt

    with signals_to(interrupt), pytest.raises(KeyboardInterrupt):
        print("step 1", file=stream, flush=True)
    stream.write("stopped\n")
    stream.flush()
    assert raw.taken.endswith(b"stopped\n")


def test_what_is_written_arrives():
    reader, writer = os.pipe()
    stream = Lasting(os.fdopen(writer, "w"))
    stream.write("one ")
    stream.writelines(["two ", "three"])
    stream.close()
    with os.fdopen(reader) as arrived:
        assert arrived.read() == "one two three"


@pytest.mark.parametrize(
    ("foreign", "shown"),
    [
        ("\x1b]0;evil\x07", r"\x1b]0;evil\x07"),
        ("\x1b[2J", r"\x1b[2J"),
        ("\x9b2J", r"\x9b2J"),
        ("photo\u202egpj.exe", r"photo\u202egpj.exe"),
        ("a\x00b\x08", r"a\x00b\x08"),
        ("a\rringlight: all is well", r"a\rringlight: all is well"),
        ("a\x1b[1A\x1b[2K\r", r"a\x1b[1A\x1b[2K\r"),
        ("\x1b[8mhidden", r"\x1b[8mhidden"),
    ],
)
def test_what_would_rewrite_the_terminal_is_shown_as_an_escape(foreign: str, shown: str):
    assert printable(f"scene {foreign} 3 views\n") == f"scene {shown} 3 views\n"


@given(st.text(st.characters(exclude_categories=("Cc", "Cs"), exclude_characters="\u202a\u202b\u202c\u202d\u202e")))
def test_words_of_any_script_are_left_alone(text: str):
    assert printable(text) == text or any("\u2066" <= letter <= "\u2069" for letter in text)


def test_tables_and_bars_keep_what_draws_them():
    console = Console(file=io.StringIO(), force_terminal=True, color_system="truecolor")
    with Progress(console=console) as bar:
        bar.add_task("steps", total=3)
        bar.update(bar.task_ids[0], completed=2)
        bar.refresh()
    console.print("[bold red on blue]28.2[/]")
    drawn = console.file.getvalue()
    assert "\x1b[" in drawn
    assert printable(drawn, drawn=True) == drawn


def test_the_name_in_a_strangers_model_does_not_reach_the_terminal_raw(trained: dict[str, Path], tmp_path: Path):
    folder = tmp_path / "run\x1b]0;evil\x07"
    shutil.copytree(trained["3dgs"], folder)
    done = subprocess.run([*RINGLIGHT, "info", str(folder)], capture_output=True, text=True, timeout=60, check=False)
    assert done.returncode == 0
    assert "\x1b" not in done.stdout + done.stderr
    assert r"\x1b]0;evil\x07" in done.stdout


def trained_through(script: str, tiny: Path, run: Path, **environment: str) -> "subprocess.CompletedProcess[str]":
    """The script, a line of bash in which "$@" is a training of the tiny scene."""
    words = [*RINGLIGHT, "train", str(tiny), "3dgs", "--out", str(run), *TALKATIVE]
    done = subprocess.run(
        ["bash", "-o", "pipefail", "-c", script, "bash", *words],
        capture_output=True,
        text=True,
        timeout=120,
        check=False,
        env=os.environ | environment,
    )
    assert "Traceback" not in done.stderr
    return done


@pytest.mark.parametrize(
    "script",
    [
        '"$@" 2>&1 | head -1',
        '"$@" 2>&1 | true',
        '"$@" 2>&-',
        '"$@" >&-',
        '"$@" >&- 2>&- <&-',
        '"$@" > /dev/full 2>&1',
    ],
)
def test_a_training_outlives_its_output(script: str, tiny: Path, trained: dict[str, Path], tmp_path: Path):
    done = trained_through(script, tiny, tmp_path / "run")
    model = tmp_path / "run" / "model.safetensors"
    assert model.read_bytes() == (trained["3dgs"] / "model.safetensors").read_bytes()
    assert (tmp_path / "run" / "report.json").is_file()
    assert done.returncode == 0 or "/dev/full" in script


@pytest.mark.parametrize(
    ("words", "unbuffered"),
    [(["--help"], ""), (["--help"], "1"), (["--version"], ""), (["info"], ""), (["info"], "1"), (["doctor"], "1")],
)
def test_a_full_disk_behind_standard_output_is_one_sentence(
    words: list[str], unbuffered: str, trained: dict[str, Path]
):
    words = [*words, str(trained["3dgs"])] if words == ["info"] else words
    done = subprocess.run(
        ["bash", "-c", '"$@" > /dev/full', "bash", *RINGLIGHT, *words],
        capture_output=True,
        text=True,
        timeout=120,
        check=False,
        env=os.environ | {"PYTHONUNBUFFERED": unbuffered},
    )
    assert done.returncode == 1
    assert len(done.stderr.splitlines()) == 1
    assert "No space left" in done.stderr


@pytest.mark.parametrize(
    ("words", "closed"),
    [
        (["--help"], ">&-"),
        (["--help"], ">&- 2>&- <&-"),
        (["info"], ">&-"),
        (["info"], "2>&-"),
        (["info"], ">&- 2>&- <&-"),
        (["compare"], ">&- 2>&- <&-"),
        (["train", "--help"], ">&-"),
    ],
)
def test_a_command_whose_output_is_closed_ends_as_if_it_were_not(
    words: list[str], closed: str, trained: dict[str, Path]
):
    words = [*words, str(trained["3dgs"])] if words[0] in ("info", "compare") else words
    done = subprocess.run(
        ["bash", "-c", f'"$@" {closed}', "bash", *RINGLIGHT, *words],
        capture_output=True,
        text=True,
        timeout=120,
        check=False,
    )
    assert (done.returncode, "Traceback" in done.stderr) == (0, False)


@pytest.mark.parametrize("encoding", ["ascii", "latin-1", "utf-8"])
def test_a_table_is_printed_in_any_encoding(encoding: str, tiny: Path, tmp_path: Path):
    done = trained_through('"$@"', tiny, tmp_path / "run", PYTHONIOENCODING=encoding, COLUMNS="100")
    assert done.returncode == 0
    assert "PSNR" in done.stdout
    helped = subprocess.run(
        [*RINGLIGHT, "train", "--help"],
        capture_output=True,
        timeout=60,
        check=False,
        env=os.environ | {"PYTHONIOENCODING": encoding},
    )
    assert helped.returncode == 0
    assert helped.stderr == b""


@pytest.mark.parametrize("columns", ["0", "-3", "wide", "1"])
def test_a_table_has_room_whatever_the_terminal_claims(columns: str, tiny: Path, tmp_path: Path):
    done = trained_through('"$@"', tiny, tmp_path / "run", COLUMNS=columns)
    assert done.returncode == 0
    assert "3dgs" in done.stdout
