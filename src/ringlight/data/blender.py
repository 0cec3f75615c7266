"""NeRF-Synthetic and Shiny-Blender: transforms_train.json, transforms_test.json, RGBA images.

Only images that the JSON lists are read, so that normal, depth and alpha maps in the test folder do no harm;
transforms_val.json is not used, as in the literature.
"""

from pathlib import Path

from ringlight.core.scene import Scene
from ringlight.data.capture import Capture, scene_from
from ringlight.data.json_fields import read_object
from ringlight.data.kept_pixels import Keeper
from ringlight.data.options import SceneOptions
from ringlight.data.splits import Split, split_of
from ringlight.data.transforms import read_frames

LOOKS_FOR = "transforms_train.json"


def recognises(folder: Path) -> bool:
    """Whether the folder is laid out like NeRF-Synthetic."""
    return (folder / LOOKS_FOR).is_file()


def load(folder: Path, options: SceneOptions, keeper: Keeper | None = None) -> Scene:
    """The scene; without transforms_test.json test images are held out.

    Raises:
        SceneError: see :func:`ringlight.data.transforms.read_frames`.
    """
    train_file, test_file = folder / LOOKS_FOR, folder / "transforms_test.json"
    train = read_frames(read_object(train_file), train_file)
    own, frames = None, train
    if test_file.is_file():
        # Where all are for training, whatever the scene says, a list without test images says the same.
        test = read_frames(read_object(test_file), test_file, may_be_none=options.holdout_every == 0)
        own, frames = Split(train, test, "split: transforms_train.json and transforms_test.json"), [*train, *test]
    return scene_from(Capture("blender", split_of(frames, own, options, train_file)), folder, options, keeper)
