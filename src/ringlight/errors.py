"""Every error that a user can cause, as one tree; each message says what is wrong, where, and the remedy.

RinglightError
├── SceneError       a folder of photographs cannot be read
├── ModelFileError   a model, checkpoint or PLY file cannot be read
├── OutputError      a file cannot be written: no space, no permission, something in the way
├── RunError         a run folder is missing, damaged, or holds another run
├── RecipeError      settings that cannot work together
├── DivergedError    the numbers of a run are no longer finite
└── BackendError     a rasterizer or an optional library is missing on this machine
"""


class RinglightError(Exception):
    """Base of all errors that end in one sentence for the user, exit code 1."""


class SceneError(RinglightError):
    """A scene cannot be read."""


class ModelFileError(RinglightError):
    """A model, checkpoint or PLY file cannot be read."""


class OutputError(RinglightError):
    """A file cannot be written; what stood there before is untouched, unless the disk fails at the very last."""


class RunError(RinglightError):
    """A run folder is missing, damaged, or already holds another run."""


class RecipeError(RinglightError):
    """Settings that cannot work, or cannot work together."""


class DivergedError(RinglightError):
    """The numbers of a run are no longer finite; what was saved before is."""


class BackendError(RinglightError):
    """A rasterizer or an optional library is not available on this machine."""


class RinglightWarning(UserWarning):
    """What the command says in a line of its own; the message is one sentence, or two."""


class DoubtWarning(RinglightWarning):
    """A user's photographs or masks cannot all be right; the message says which, and what is done."""


class FallbackWarning(RinglightWarning):
    """Something slower, or nothing, takes the place of what this machine has but cannot use; the message says why."""
