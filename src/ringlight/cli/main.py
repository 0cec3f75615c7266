"""The command ``ringlight``: verb, then the file or folder it acts on, then options.

Results go to standard output, everything else to standard error. Exit code 1 for wrong input, 2 for wrong usage, 128
and the number of the signal for a run that one stopped.
Each verb is a module of this folder, imported only when it is asked for: ``--help`` must not wait for torch.
"""

import os
import sys
import warnings
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from difflib import get_close_matches
from importlib import import_module
from pathlib import Path
from typing import Any, NoReturn

from ringlight import __version__
from ringlight.cli.flags import by_flag
from ringlight.cli.signals import interrupt, signal_of, signals_to
from ringlight.cli.streams import Lasting, lasting_streams, what_flushing_met
from ringlight.cli.system_refusals import met_in_links, sentence_on
from ringlight.errors import RinglightError, RinglightWarning, RunError

WRONG_INPUT, WRONG_USAGE = 1, 2

SIGNALLED = 128
"""Plus the signal's number: what shells make of it."""

NO_MEMORY = (
    "not enough memory; close other programs, or try --downscale 2, a smaller --densify.max-gaussians or, for a "
    "volume, fewer --rays"
)
NO_MEMORY_HERE = "not enough memory; close other programs, or ask for less"
"""Of commands that do not train, and have no such flags."""


class Stopped(Exception):
    """A signal ended a command that has put everything in order since."""

    def __init__(self, number: int):
        super().__init__(number)
        self.code = SIGNALLED + number


SLOW_TO_BEGIN = (
    "demo",
    "poses",
    "train",
    "eval",
    "render",
    "view",
    "share",
    "compare",
    "normals",
    "report",
    "info",
    "compress",
    "edit",
    "relight",
    "export",
    "import",
)
"""Commands that load torch and say what is under way."""

TRAINING = ("train", "relight", "demo", "study", "table")
"""Commands that have the flags of a training."""

VERBS = {
    "demo": "train on a bundled scene and compare with 3DGS: start here",
    "poses": "find the cameras of photographs, or of a film",
    "train": "learn a scene from a folder of posed photographs",
    "eval": "measure a model on held-out photographs",
    "render": "pictures or video: test views, an orbit, a path; base colour, residual, depth, ...",
    "view": "look at models or a scene in a browser",
    "compare": "several runs in one table and one contact sheet",
    "normals": "how right models' normals are, in degrees to true ones",
    "report": "one page about runs: table, curves, pictures with a curtain, settings",
    "table": "methods over scenes and seeds, side by side or on a cluster, to one table a measure",
    "study": "repeat the paper's ablations: the whole matrix, its table and curves",
    "reproduce": "the paper's claims one by one, held against records of ours",
    "info": "what a model file or run folder holds",
    "compress": "write a model in about a third of the bytes, and say what that costs",
    "edit": "write a model in edited light: tinted, with more or less of what depends on the view",
    "relight": "learn the light of other photographs for a model, as a pack of a few tens of kilobytes",
    "share": "one HTML page that shows the model itself in any browser",
    "export": "write a file that other programs open",
    "import": "make a model of a PLY that another program wrote",
    "bench": "speed of the rasterizer, the colour field, a training step",
    "doctor": "check this machine and this installation",
    "fetch-lpips": "download the weights of the LPIPS measure",
}
"""Each command with one line of help; the module that runs it has its name."""


def main(arguments: Sequence[str] | None = None) -> NoReturn:
    """Run one verb and exit."""
    # Before torch is imported: its idle OpenMP threads would spin on the cores that our kernels use.
    os.environ.setdefault("OMP_WAIT_POLICY", "passive")
    lasting_streams()
    try:
        with signals_to(interrupt):
            code = run(list(sys.argv[1:] if arguments is None else arguments))
    except OSError as error:
        code = _system_refused(error)
    except KeyboardInterrupt as interruption:  # while the command began, or while it said that it ends
        code = _interrupted(interruption)
    lost = what_flushing_met()
    sys.exit(_system_refused(lost) if lost and not code else code)


def run(arguments: list[str]) -> int:
    """Run one verb; returns the exit code. A user's mistake is one sentence on standard error."""
    if arguments[:1] == ["help"] and arguments[1:2] and arguments[1] in VERBS:
        return _run_verb(arguments[1], ["--help"])
    if not arguments or arguments[0] in ("-h", "--help", "help"):
        sys.stdout.write(_overview())
        return 0
    if arguments[0] in ("-V", "--version"):
        sys.stdout.write(f"ringlight {__version__}\n")
        return 0
    if arguments[0] not in VERBS:
        return _complain(f"no command is called {arguments[0]!r}; {_suggestion(arguments[0])}", WRONG_USAGE)
    return _run_verb(arguments[0], arguments[1:])


def run_verb_alone(verb: str) -> NoReturn:
    """As :func:`main`, for a module that another process of ours starts."""
    os.environ.setdefault("OMP_WAIT_POLICY", "passive")
    lasting_streams()
    sys.exit(_run_verb(verb, []))


def _run_verb(verb: str, arguments: list[str]) -> int:
    _show_beginning(verb, arguments)
    try:
        _refuse_lost_folder()
        with _warnings_as_sentences():
            return int(import_module(f"ringlight.cli.{verb.replace('-', '_')}").main(arguments))
    except SystemExit as stop:
        # The parser of the command line ends so: 0 after --help, 2 after its own sentence.
        return int(stop.code or 0)
    except RinglightError as error:
        return _complain(by_flag(str(error), arguments), WRONG_INPUT)
    except Stopped as stopped:
        return stopped.code
    except KeyboardInterrupt as interruption:
        return _interrupted(interruption)
    except (MemoryError, RuntimeError) as error:
        circle = met_in_links(error)
        if circle is not None:
            return _system_refused(circle)
        if not is_out_of_memory(error):
            raise
        return _complain(NO_MEMORY if verb in TRAINING else NO_MEMORY_HERE, WRONG_INPUT)
    except ImportError as error:
        return _complain(_what_cannot_be_loaded(error), WRONG_INPUT)
    except OSError as error:
        return _system_refused(error)


@contextmanager
def _warnings_as_sentences() -> Iterator[None]:
    """Inside the block our own warnings are a line on standard error each, without Python's place in the source."""
    with warnings.catch_warnings():
        warnings.simplefilter("always", RinglightWarning)
        others = warnings.showwarning

        def show(message: Warning | str, category: type[Warning], *place: Any, **where: Any) -> None:
            if issubclass(category, RinglightWarning):
                sys.stderr.write(f"warning: {message}\n")
            else:
                others(message, category, *place, **where)

        warnings.showwarning = show
        yield


def _show_beginning(verb: str, arguments: list[str]) -> None:
    """On a terminal a line at once, in place of which comes whatever is said next: loading libraries takes seconds."""
    helped = {"-h", "--help", "--quiet"} & set(arguments)
    if verb in SLOW_TO_BEGIN and not helped and isinstance(sys.stderr, Lasting) and sys.stderr.isatty():
        sys.stderr.draw(f"ringlight {verb}: starting")


def _refuse_lost_folder() -> None:
    """A process may stand in a folder that was deleted; libraries end it there without a word of sense."""
    try:
        Path.cwd()
    except FileNotFoundError:
        raise RunError("the folder that this shell stands in was deleted; change to another with cd") from None


def _what_cannot_be_loaded(error: ImportError) -> str:
    """A sentence on a library that is there and cannot be loaded; an own module that cannot is a bug."""
    if (error.name or "").startswith("ringlight"):
        raise error
    reason = " ".join(str(error).split())
    return f"a library cannot be loaded ({reason}); free some memory if that is short, and see 'ringlight doctor'"


def is_out_of_memory(error: BaseException) -> bool:
    """Whether it says so; torch has a class for this on GPUs alone, known by its name: torch is not imported here."""
    on_gpu = type(error).__name__ == "OutOfMemoryError"
    return isinstance(error, MemoryError) or on_gpu or "DefaultCPUAllocator" in str(error)


def _system_refused(error: OSError) -> int:
    """What the user can mend is a sentence; anything else is a bug and raised again."""
    sentence = sentence_on(error)
    if sentence is None:
        raise error
    return _complain(sentence, WRONG_INPUT)


def _complain(sentence: str, code: int) -> int:
    sys.stderr.write(f"ringlight: {sentence}\n")
    return code


def _interrupted(by: KeyboardInterrupt) -> int:
    return _complain("interrupted", SIGNALLED + signal_of(by))


def _suggestion(word: str) -> str:
    near = get_close_matches(word, VERBS, n=1)
    return f"perhaps you meant 'ringlight {near[0]}'" if near else "see 'ringlight --help'"


def _overview() -> str:
    width = max(len(name) for name in VERBS)
    lines = [
        f"ringlight {__version__}: 3D scenes from photographs, as Gaussians lit by one shared light field.",
        "",
        "usage: ringlight COMMAND ...        (ringlight COMMAND --help explains one)",
        "",
        *(f"  {name:{width}}  {about}" for name, about in VERBS.items()),
        "",
        "first hour:",
        "  ringlight demo                                 two methods on a chrome toaster, side by side",
        "  ringlight train my-photos ringlight            your own scene (COLMAP, Blender or nerfstudio folder)",
        "  ringlight render runs/my-photos-ringlight --path orbit",
        "",
    ]
    return "\n".join(lines)
