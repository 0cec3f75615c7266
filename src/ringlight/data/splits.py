"""Which photographs train and which test: by the user's wish, by the scene's own lists, or every n-th."""

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

from ringlight.core.words import counted
from ringlight.data.folder import read_bytes, shown
from ringlight.data.frame import Frame
from ringlight.data.options import ReadingOptions
from ringlight.errors import SceneError

LIST_SUFFIX = ".txt"
"""Of a file that lists test images."""

LARGEST_LIST = 10_000_000
"""Bytes; a hundred thousand names."""

BEGINNING = 65_536
"""Bytes of a photograph that are compared before all are."""

MOST_NAMED = 3
"""Images that a sentence names."""


@dataclass(frozen=True)
class Split:
    """Frames of both kinds, and the rule in words. ``test`` may be empty."""

    train: list[Frame]
    test: list[Frame]
    note: str
    warnings: tuple[str, ...] = ()


def split_of(frames: Sequence[Frame], own: Split | None, options: ReadingOptions, source: Path) -> Split:
    """What ``options`` ask for, else the scene's ``own`` split, else every n-th of ``frames`` by name, from the first.

    Raises:
        SceneError: no image is left to train on, or a name in the user's list is none of an image.
    """
    stated = options.holdout_every not in (0, ReadingOptions.holdout_every)
    useless = (f"warning: --holdout-every {options.holdout_every} has no effect: the split is another",) * stated
    if own is not None and options.holdout is None and options.holdout_every != 0:
        if own.test or not stated:
            return replace(own, warnings=useless)
        frames = own.train  # of a scene that states no test images
    ordered = sorted({frame.path: frame for frame in frames}.values(), key=lambda frame: frame.name)
    twice = _twice(frames, "listed", " and used once")
    return replace(_split(ordered, options, source), warnings=(*twice, *(useless if options.holdout else ())))


def _split(ordered: list[Frame], options: ReadingOptions, source: Path) -> Split:
    if options.holdout is not None:
        return _by_names(ordered, wished_names(options.holdout), source)
    if options.holdout_every == 0:
        return Split(ordered, [], "split: all photographs are for training; there are no test views")
    if len(ordered) < 2:
        raise SceneError(
            f"{source}: {len(ordered)} image is too few to hold one out for testing; add photographs, or give "
            "--holdout-every 0"
        )
    every = options.holdout_every
    train = [frame for index, frame in enumerate(ordered) if index % every]
    note = f"split: of the images sorted by name, each with index % {every} == 0 is a test image"
    return Split(train, ordered[::every], note)


def wished_names(holdout: str) -> list[str]:
    """The names of ``--holdout``: those in a list, one a line, or with commas between.

    Raises SceneError for a list that cannot be read, or no name at all.
    """
    text = holdout
    if _is_list(holdout):
        text = _read_list(Path(holdout))
    names = [name.strip() for name in text.split("\n" if "\n" in text else ",")]
    names = [name for name in names if name]
    if not names:
        raise SceneError(
            f"--holdout {shown(holdout)} names no image; give names, or --holdout-every 0 for no test views"
        )
    return names


def spelled_out(holdout: str) -> str:
    """The same test images without their list, one a line: what a run keeps. Raises SceneError."""
    return "\n".join(wished_names(holdout)) + "\n" if _is_list(holdout) else holdout


def _is_list(holdout: str) -> bool:
    return holdout.lower().endswith(LIST_SUFFIX) and "\n" not in holdout and "," not in holdout


def _read_list(path: Path) -> str:
    if path.is_file() and path.stat().st_size > LARGEST_LIST:
        raise SceneError(f"{path}: is too large for a list of images; give a text file with a name on each line")
    try:
        return read_bytes(path).decode().removeprefix("\ufeff") + "\n"
    except UnicodeDecodeError as error:
        raise SceneError(f"{path}: is no text; give a file with the name of an image on each line") from error


def _by_names(ordered: list[Frame], names: Sequence[str], source: Path) -> Split:
    held = {_named(ordered, name, source).path for name in names}
    train = [frame for frame in ordered if frame.path not in held]
    test = [frame for frame in ordered if frame.path in held]
    return Split(train, test, f"split: --holdout names {counted(len(test), 'test image')}")


def _named(frames: Sequence[Frame], name: str, source: Path) -> Frame:
    """The frame of that name, or the only one whose name ends in it."""
    wanted = name.replace("\\", "/").removeprefix("./")
    found = [frame for frame in frames if frame.name == wanted]
    found = found or [frame for frame in frames if frame.name.endswith(f"/{wanted}")]
    if not found:
        raise SceneError(f"--holdout names {shown(name)}, which is none of the images of {source}; correct the name")
    if len(found) > 1:
        both = " and ".join(frame.name for frame in found[:2])
        raise SceneError(f"{source}: --holdout names {shown(name)}, which may be {both}; give the folder too")
    return found[0]


def split_warnings(train: Sequence[Frame], test: Sequence[Frame]) -> list[str]:
    """Sentences on frames that are listed twice, and on test views that are training views too, as files or bytes."""
    notes = [*_twice(train, "a training view"), *_twice(test, "a test view")]
    seen = {frame.path for frame in train}
    both = [frame.name for frame in test if frame.path in seen]
    if both:
        notes.append(f"warning: {_some(both)} used for training and for testing: these are no held-out views")
    copies = _copies(train, [frame for frame in test if frame.path not in seen])
    if copies:
        first, second = copies[0]
        others = f", and {len(copies) - 1} more" if len(copies) > 1 else ""
        notes.append(f"warning: the test view {second} has the bytes of the training view {first}{others}")
    return notes


def _twice(frames: Sequence[Frame], what: str, then: str = "") -> tuple[str, ...]:
    counts = Counter(frame.path for frame in frames)
    names = list(dict.fromkeys(frame.name for frame in frames if counts[frame.path] > 1))
    return (f"warning: {_some(names)} {what} more than once{then}",) if names else ()


def _some(names: Sequence[str]) -> str:
    some = ", ".join(names[:MOST_NAMED]) + (", ..." if len(names) > MOST_NAMED else "")
    return f"{some} is" if len(names) == 1 else f"{len(names)} photographs ({some}) are"


def _copies(train: Sequence[Frame], test: Sequence[Frame]) -> list[tuple[str, str]]:
    """Training and test view with the same bytes; files are read only where another is as long, and begins alike."""
    sizes = {frame.path: frame.path.stat().st_size for frame in (*train, *test)}
    shared = {sizes[frame.path] for frame in train} & {sizes[frame.path] for frame in test}
    beginnings: dict[tuple[int, bytes], list[Frame]] = {}
    for frame in train:
        if sizes[frame.path] in shared:
            beginnings.setdefault((sizes[frame.path], _beginning(frame.path)), []).append(frame)
    found: list[tuple[str, str]] = []
    for frame in test:
        if sizes[frame.path] in shared:
            alike = beginnings.get((sizes[frame.path], _beginning(frame.path)), [])
            found += [(one.name, frame.name) for one in alike if one.path.read_bytes() == frame.path.read_bytes()][:1]
    return found


def _beginning(path: Path) -> bytes:
    with path.open("rb") as file:
        return file.read(BEGINNING)
