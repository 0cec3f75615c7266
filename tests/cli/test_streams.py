"""Nobody reads what a command says: it goes on all the same, and exits by what it did."""

import os
import subprocess
import sys
from pathlib import Path

import pytest
from cli_session import QUICK

from ringlight.cli.streams import Lasting

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


def test_what_is_written_arrives():
    reader, writer = os.pipe()
    stream = Lasting(os.fdopen(writer, "w"))
    stream.write("one ")
    stream.writelines(["two ", "three"])
    stream.close()
    with os.fdopen(reader) as arrived:
        assert arrived.read() == "one two three"


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
