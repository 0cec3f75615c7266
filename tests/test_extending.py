"""What docs/extending.md says works: its parts keep their contracts, and its method trains, is saved and exported."""

import subprocess
import sys
from collections.abc import Callable, Iterator
from dataclasses import replace
from inspect import signature
from pathlib import Path
from types import ModuleType
from typing import Any

import numpy as np
import pytest
import torch
from scenes_on_disk import write_tiny_scene
from torch import Tensor

from contracts import (
    methods,
    plugged,
    test_color_models,
    test_fields,
    test_formats,
    test_methods,
    test_shaders,
    test_strategies,
)
from extended import FILES, LINES, plugged_in
from ringlight.color.contract import ColorModel
from ringlight.color.ringlight import RingLight
from ringlight.core.scene import Scene
from ringlight.core.want import Want
from ringlight.fields.contract import LightField
from ringlight.files.formats.contract import Writer
from ringlight.files.formats.table import WRITERS
from ringlight.fit.strategies.contract import Strategy
from ringlight.fit.train import Training, train
from ringlight.methods.recipe import Recipe
from ringlight.methods.store import StoredModel, load_model, model_header, save_model, scene_facts
from ringlight.methods.table import METHODS
from ringlight.rasterize.choose import rasterizer_for
from ringlight.runs.export import export
from ringlight.shade.contract import Shader
from small_recipes import small
from tiny_scene import tiny_scene

STEPS = 20
SCENE = tiny_scene(views=6, size=24)

CONTRACTS: dict[str, tuple[ModuleType, dict[str, Any]]] = {
    "colour model": (test_color_models, {"name": "haze", "ambient": torch.no_grad}),
    "colour model of the field": (test_color_models, {"name": "light: fourier", "ambient": torch.no_grad}),
    "shader": (test_shaders, {"name": "air", "ambient": torch.no_grad}),
    "field": (test_fields, {"name": "fourier", "dtype": torch.float64}),
    "strategy": (test_strategies, {"name": "shorten"}),
    "format": (test_formats, {"suffix": ".xyz", "name": "haze"}),
    "method": (test_methods, {"name": "haze"}),
}
"""Where the contract of each part is tested, and what its tests are asked for."""

CASES = [
    pytest.param(test, asked, id=f"{part}: {name}")
    for part, (module, asked) in CONTRACTS.items()
    for name, test in vars(module).items()
    if name.startswith("test_")
]


@pytest.fixture(scope="module", autouse=True)
def page(tmp_path_factory: pytest.TempPathFactory) -> Iterator[dict[str, Any]]:
    """What the page defines, plugged in; also into those tables of the tests that follow from others."""
    with pytest.MonkeyPatch.context() as patch:
        names = plugged_in(tmp_path_factory.mktemp("src"), patch)
        lit = replace(plugged.LIGHT, field="fourier")
        patch.setitem(plugged.COLOR_MODELS, "light: fourier", lambda: RingLight(lit, plugged.BOX, 1))
        patch.setitem(methods.TRAINED, "haze", METHODS["haze"])
        patch.setitem(test_formats.SUFFIXES, ".xyz", WRITERS[".xyz"])
        yield names


@pytest.fixture(scope="module")
def trained(page: dict[str, Any]) -> Training:
    """The method of the page after its last step."""
    training = replace(METHODS["haze"], steps=STEPS).build(SCENE, rasterizer_for("auto"), 0)
    for progress in train(training):
        assert progress.fault is None
        assert set(progress.losses) == {"photometric", "haze"}
    return training


def shown(model: Any, scene: Scene = SCENE) -> Tensor:
    return model.render(scene.test[0].camera, scene.background_color, Want.EXACT).color


def error(training: Training) -> float:
    """Over all photographs of the training."""
    views, behind = SCENE.train, SCENE.background_color
    pairs = [(training.model.render(view.camera, behind).color, view.image(behind)) for view in views]
    return sum((color.permute(2, 0, 1) - image).abs().mean().item() for color, image in pairs) / len(views)


def stored(training: Training, name: str, recipe: Any, path: Path) -> StoredModel:
    """The model from its file."""
    header = model_header(name, recipe, training.step, scene_facts(SCENE))
    save_model(path, training.model, header, [view.camera for view in SCENE.train])
    return load_model(path, rasterizer_for("auto"))


def test_the_page_has_a_file_for_each_of_its_parts_and_the_lines_that_plug_them_in():
    assert list(FILES) == [
        "ringlight/color/haze.py",
        "ringlight/shade/air.py",
        "ringlight/fields/fourier.py",
        "ringlight/fit/strategies/shorten.py",
        "ringlight/files/formats/xyz.py",
        "ringlight/methods/haze.py",
    ]
    tables = ["COLOR_MODELS", "SHADERS", "FIELDS", "STRATEGIES", "WRITERS", "MEANS", "METHODS"]
    assert [table for table, _, _ in LINES] == tables


def test_every_part_is_what_its_contract_asks_for(page: dict[str, Any]):
    assert isinstance(page["Haze"](), ColorModel)
    assert isinstance(page["Air"](), Shader)
    assert isinstance(page["FourierField"](plugged.RING, torch.Generator()), LightField)
    assert isinstance(page["Shorten"](5, 0.1), Strategy)
    assert isinstance(page["PointList"](), Writer)
    assert isinstance(page["HazeRecipe"](), Recipe)


@pytest.mark.parametrize(("test", "asked"), CASES)
def test_the_contract_is_kept(
    test: Callable[..., None], asked: dict[str, Any], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
):
    """Gradients in float64 and finite differences among it."""
    given = asked | {"tmp_path": tmp_path, "monkeypatch": monkeypatch}
    test(**{name: given[name] for name in signature(test).parameters})


def test_the_methods_error_falls(trained: Training):
    assert error(trained) < 0.9 * error(METHODS["haze"].build(SCENE, rasterizer_for("auto"), 0))


def test_a_saved_method_shows_the_same_bits(trained: Training, tmp_path: Path):
    recipe = replace(METHODS["haze"], steps=STEPS)
    again = stored(trained, "haze", recipe, tmp_path / "model.safetensors")
    assert again.header.method == "haze"
    assert torch.equal(shown(again.model), shown(trained.model))


def test_haze_is_nothing_behind_the_subject(trained: Training):
    """The shader takes the background off before it looks at the light in front."""
    camera, model = SCENE.test[0].camera, trained.model
    black, white = (model.render(camera, torch.full((3,), grey)) for grey in (0.0, 1.0))
    torch.testing.assert_close(white.color - black.color, (1 - black.alpha).expand_as(black.color))


def test_the_strategy_has_cut_what_was_too_long(trained: Training):
    *_, shorten = trained.strategies
    longest = METHODS["haze"].longest * SCENE.extent
    table = trained.model.splats().gaussians
    assert shorten.state()["cut"] > 0
    assert STEPS % shorten.every == 0
    assert table.scales.max() <= longest * (1 + 1e-6)


def test_the_field_lights_gaussians_and_comes_back_from_a_file(tmp_path: Path):
    recipe = small("ringlight-ring", steps=STEPS, warmup=0.2, light={"field": "fourier"})
    training = recipe.build(SCENE, rasterizer_for("auto"), 0)
    before = training.model.get_parameter("color.fourier.mix").clone()
    for progress in train(training):
        assert progress.fault is None
    model = training.model
    assert not torch.equal(model.get_parameter("color.fourier.mix"), before)
    lit = shown(model)
    assert torch.equal(shown(stored(training, "ringlight-ring", recipe, tmp_path / "lit.safetensors").model), lit)
    model.get_buffer("color.lit").fill_(False)
    assert not torch.equal(shown(model), lit)


def test_the_format_holds_a_line_for_each_gaussian(trained: Training, tmp_path: Path):
    model = stored(trained, "haze", replace(METHODS["haze"], steps=STEPS), tmp_path / "model.safetensors")
    exported = export(model, tmp_path / "points.xyz", fit_steps=2)
    rows = np.loadtxt(exported.file, dtype=np.float32)
    assert rows.shape == (exported.counted, 6)
    assert exported.counted == len(trained.model.splats())
    means = trained.model.splats().gaussians.means.detach().numpy()
    assert np.array_equal(rows[:, :3], means)
    assert np.array_equal(rows[:, 3:], rows[:, 3:].round())
    assert rows[:, 3:].min() >= 0
    assert rows[:, 3:].max() <= 255


ALONE = """
import sys
from pathlib import Path
import pytest
sys.path[:0] = sys.argv[1].split(":")
from extended import plugged_in
plugged_in(Path(sys.argv[2]), pytest.MonkeyPatch())
from ringlight.cli.main import run
scene, out = sys.argv[3:]
quick = ["--steps", "8", "--quiet", "--lpips"]
field = ["--light.field", "fourier", "--light.ring.rank", "4"]
codes = [
    run(["train", scene, "haze", "--longest", "0.05", "--out", f"{out}/haze", *quick]),
    run(["export", f"{out}/haze", f"{out}/points.xyz"]),
    run(["train", scene, "ringlight-ring", "--out", f"{out}/lit", *field, *quick]),
]
sys.exit(any(codes))
"""


def test_the_commands_of_the_page_do_what_it_says(tmp_path: Path):
    """In a process of their own: the command line reads the tables when it is imported."""
    scene, here = write_tiny_scene(tmp_path / "scene"), Path(__file__).parent
    paths = ":".join(str(path) for path in (here, *(here / name for name in ("cli", "shade"))))
    words = [sys.executable, "-c", ALONE, paths, str(tmp_path / "src"), str(scene), str(tmp_path / "out")]
    done = subprocess.run(words, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    assert (tmp_path / "out" / "points.xyz").stat().st_size > 0
    assert (tmp_path / "out" / "lit" / "model.safetensors").exists()


@pytest.mark.parametrize("name", ["ringlight.methods.haze", "ringlight.files.formats.xyz"])
def test_what_the_command_line_lists_does_without_torch(name: str, tmp_path: Path):
    path = name.replace(".", "/") + ".py"
    (tmp_path / "part.py").write_text(FILES[path], encoding="utf-8")
    code = "import sys; sys.path.insert(0, sys.argv[1]); import part; sys.exit('torch' in sys.modules)"
    assert subprocess.run([sys.executable, "-c", code, str(tmp_path)], check=False).returncode == 0
