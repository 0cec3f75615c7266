"""A model file gives back its tensors and its header, and says what is wrong when it cannot."""

import math
from dataclasses import replace
from pathlib import Path

import pytest
import torch

from ringlight.errors import ModelFileError
from ringlight.files.model_file import (
    FORMAT,
    LIGHT_PROGRAM,
    ModelHeader,
    SceneFacts,
    read_model_file,
    write_model_file,
)
from ringlight.files.tensor_file import read_tensors, write_tensors

SCENE = SceneFacts(
    name="toaster",
    source="data/toaster",
    background="white",
    resolution=(200, 150),
    box=((-1.5, -1.25, -1.0), (1.5, 1.25, 0.1)),
    extent=4.4,
    notes=("every 8th image is a test image", "größer"),
    options={"downscale": 2},
)
HEADER = ModelHeader(
    method="ringlight",
    preset="ringlight-paper",
    recipe={"steps": 7000, "ring": {"rank": 16}, "name": None},
    step=7000,
    scene=SCENE,
    metrics={"psnr": 35.7, "lpips": None, "perfect": math.inf},
    versions={"ringlight": "0.1.0", "torch": "2.13.0", "python": "3.11.2"},
)
TENSORS = {"columns.means": torch.arange(6.0).reshape(2, 3), "color.ring.cores.0": torch.ones(2, 2)}


def with_metadata(path: Path, **changes: str | None) -> None:
    """A model file with some header fields replaced, or removed where None."""
    write_model_file(path, TENSORS, HEADER)
    file = read_tensors(path)
    metadata = file.metadata | changes
    write_tensors(path, file.tensors, {name: value for name, value in metadata.items() if value is not None})


def test_write_then_read_gives_the_same(tmp_path: Path) -> None:
    header = replace(HEADER, created="2026-11-03 12:00")
    write_model_file(tmp_path / "model.safetensors", TENSORS, header)
    found = read_model_file(tmp_path / "model.safetensors")
    assert found.header == header
    assert found.tensors.keys() == TENSORS.keys()
    assert all(torch.equal(found.tensors[name], tensor) for name, tensor in TENSORS.items())


def test_the_header_is_json_for_every_reader(tmp_path: Path) -> None:
    path, lost = tmp_path / "model.safetensors", replace(HEADER, storage={"picture_psnr": math.inf, "worst": math.nan})
    write_model_file(path, TENSORS, lost)
    for text in read_tensors(path).metadata.values():
        assert "Infinity" not in text
        assert "NaN" not in text
    storage = read_model_file(path).header.storage
    assert storage["picture_psnr"] == math.inf
    assert math.isnan(storage["worst"])


def test_settings_may_be_infinite(tmp_path: Path) -> None:
    path, never = tmp_path / "model.safetensors", {"densify": {"prune_scale": math.inf}, "rates": [1.0, -math.inf]}
    write_model_file(path, TENSORS, replace(HEADER, recipe=never))
    assert "Infinity" not in read_tensors(path).metadata["recipe"]
    assert read_model_file(path).header.recipe == never


def test_files_of_earlier_versions_have_infinity_as_a_bare_word(tmp_path: Path) -> None:
    path = tmp_path / "model.safetensors"
    with_metadata(path, metrics='{"psnr": Infinity}', recipe='{"prune_scale": Infinity}')
    header = read_model_file(path).header
    assert header.metrics == {"psnr": math.inf}
    assert header.recipe == {"prune_scale": math.inf}


@pytest.mark.parametrize("word", ["NaN", "Infinity", "-Infinity"])
def test_a_header_that_is_no_json_is_refused(tmp_path: Path, word: str) -> None:
    path, header = tmp_path / "model.safetensors", f'{{"a":{word}}}'.encode()
    path.write_bytes(len(header).to_bytes(8, "little") + header)
    with pytest.raises(ModelFileError, match="its header is not JSON"):
        read_tensors(path)


def test_equal_models_give_equal_bytes(tmp_path: Path) -> None:
    write_model_file(tmp_path / "one", TENSORS, HEADER)
    shuffled = replace(HEADER, recipe=dict(reversed(HEADER.recipe.items())))
    write_model_file(tmp_path / "two", dict(reversed(TENSORS.items())), shuffled)
    assert (tmp_path / "one").read_bytes() == (tmp_path / "two").read_bytes()


def test_every_truncation_is_refused(tmp_path: Path) -> None:
    write_model_file(tmp_path / "whole", TENSORS, HEADER)
    whole = (tmp_path / "whole").read_bytes()
    for length in range(len(whole)):
        (tmp_path / "cut").write_bytes(whole[:length])
        with pytest.raises(ModelFileError, match=r"cut short|empty"):
            read_model_file(tmp_path / "cut")


def test_a_newer_format_is_refused_with_the_version_to_install(tmp_path: Path) -> None:
    path = tmp_path / "new"
    # A newer program may change every other field, so none of them may be read first.
    with_metadata(path, format=str(FORMAT + 1), versions='{"ringlight": "2.5.0"}', scene="something new")
    with pytest.raises(ModelFileError, match=r'newer ringlight.* run pip install "ringlight>=2\.5\.0"'):
        read_model_file(path)


def test_a_strangers_version_cannot_smuggle_a_command(tmp_path: Path) -> None:
    with_metadata(tmp_path / "new", format="9", versions='{"ringlight": "1; rm -rf /"}')
    with pytest.raises(ModelFileError, match=r"run pip install --upgrade ringlight$"):
        read_model_file(tmp_path / "new")


def test_another_safetensors_file_is_no_model_of_ours(tmp_path: Path) -> None:
    write_tensors(tmp_path / "other", {"weight": torch.ones(1)}, {"format": "pt"})
    with pytest.raises(ModelFileError, match="not a ringlight model"):
        read_model_file(tmp_path / "other")
    write_tensors(tmp_path / "light", {"colors": torch.ones(3, 4)}, {"program": LIGHT_PROGRAM})
    with pytest.raises(ModelFileError, match=r"light pack.*ringlight edit"):
        read_model_file(tmp_path / "light")


@pytest.mark.parametrize(
    ("field", "value"),
    [
        ("format", None),
        ("format", "one"),
        ("method", None),
        ("step", "-1"),
        ("step", "many"),
        ("recipe", "{"),
        ("recipe", "[1]"),
        ("recipe", "[" * 50_000),
        ("metrics", None),
        ("versions", "3"),
        ("scene", "{}"),
        ("scene", '{"name": 1}'),
    ],
)
def test_a_damaged_field_is_named(tmp_path: Path, field: str, value: str | None) -> None:
    with_metadata(tmp_path / "damaged", **{field: value})
    with pytest.raises(ModelFileError, match=r"damaged.*; copy it again"):
        read_model_file(tmp_path / "damaged")
