"""Comparing run folders: grouped by scene, refused where numbers do not compare, content without pictures."""

import zlib

import pytest
import torch
from PIL import Image
from safetensors.torch import save_file
from samples import picture, sample_report

from ringlight.errors import RunError
from ringlight.measure.compare import compare
from ringlight.measure.json_record import to_json
from ringlight.measure.lpips import tensor_shapes, weights_missing, weights_path
from ringlight.measure.picture_names import RENDERS, TRUTHS, picture_name
from ringlight.measure.report import ImageScore

VIEWS = ("r_0", "sub/r_1")
IMAGES = tuple(ImageScore(name, 22.0, 22.0, 0.88, 0.87) for name in VIEWS)


def save(path, pixels):
    path.parent.mkdir(parents=True, exist_ok=True)
    Image.fromarray((pixels * 255).round().byte().numpy()).save(path)


@pytest.fixture
def make_run(tmp_path):
    """A run folder with a report and, if wanted, pictures."""

    def make(name, truth_seed=0, pictures=True, **changes):
        folder = tmp_path / name
        folder.mkdir(parents=True)
        report = sample_report(**({"images": IMAGES} | changes))
        (folder / "report.json").write_text(to_json(report), encoding="utf-8")
        for index, view in enumerate(VIEWS if pictures else ()):
            save(folder / RENDERS / picture_name(view), picture(seed=zlib.crc32(f"{name} {view}".encode()) % 1000))
            save(folder / TRUTHS / picture_name(view), picture(seed=truth_seed + index))
        return folder

    return make


def test_runs_give_a_table_and_a_sheet(make_run):
    runs = [make_run("a"), make_run("b", preset="ringlight", psnr=25.9)]
    comparison = compare(runs)
    assert [label for label, _ in comparison.table.runs] == ["3dgs", "ringlight"]
    assert comparison.table.baseline == "3dgs"
    assert "+3.77" in comparison.table.markdown()
    assert comparison.sheet is not None
    assert comparison.notes == ()


def test_missing_lpips_is_told_as_it_is_now(make_run, tmp_path, monkeypatch):
    monkeypatch.setenv("RINGLIGHT_CACHE", str(tmp_path))
    small = "LPIPS with vgg is unavailable: it needs images of 16 pixels a side, these have 8."
    runs = [
        make_run("a", lpips_note=weights_missing("alex")),
        make_run("b", preset="ringlight", lpips_note=f"{weights_missing('alex')} {small}"),
    ]
    remedy = "LPIPS with alex was not measured in these runs; measure it with 'ringlight eval RUN'"
    assert compare(runs).table.notes()[1:] == (f"{remedy} after 'ringlight fetch-lpips'.", small)
    fetched = {name: torch.zeros(shape) for name, shape in tensor_shapes("alex").items()}
    save_file(fetched, weights_path("alex"))
    assert compare(runs).table.notes()[1:] == (f"{remedy}.", small)
    runs.append(make_run("c", preset="paper", lpips_alex=0.1, lpips_note=""))
    assert "in some of these runs" in compare(runs).table.notes()[1]


def test_scenes_are_grouped_and_their_sheets_stacked(make_run):
    toaster = [make_run("a"), make_run("b", preset="ringlight")]
    carpaint = [
        make_run("c", scene="carpaint"),
        make_run("d", scene="carpaint", preset="ringlight", background="black"),
    ]
    with pytest.raises(RunError, match="background"):
        compare([*toaster, *carpaint])
    both = compare([*toaster, carpaint[0]]).sheet
    assert both.height == compare(toaster).sheet.height + compare(carpaint[:1]).sheet.height


@pytest.mark.parametrize(
    ("field", "value"), [("background", "black"), ("resolution", "400x400"), ("split", "every 8th image")]
)
def test_runs_with_other_test_views_are_refused_with_the_reason(make_run, field, value):
    runs = [make_run("a"), make_run("b", **{field: value})]
    with pytest.raises(RunError, match=rf"{field} \(.* and {value}\)") as caught:
        compare(runs)
    assert "\n" not in str(caught.value)


def test_runs_on_other_views_or_other_photographs_are_refused(make_run):
    first = make_run("a")
    with pytest.raises(RunError, match="different test views"):
        compare([first, make_run("b", images=IMAGES[:1])])
    with pytest.raises(RunError, match="different photographs"):
        compare([first, make_run("c", truth_seed=50)])


def test_a_run_without_pictures_is_in_the_table_and_the_remedy_is_told(make_run):
    bare = make_run("bare", pictures=False)
    comparison = compare([bare, make_run("b", preset="ringlight")])
    assert len(comparison.table.runs) == 2
    assert comparison.sheet is not None
    assert len(comparison.notes) == 1
    assert f"ringlight eval {bare}" in comparison.notes[0]
    assert compare([bare]).sheet is None


def test_runs_of_one_method_are_told_apart(make_run):
    runs = [make_run("x/first"), make_run("x/second"), make_run("y/third", scene="other")]
    assert [label for label, _ in compare(runs).table.runs] == ["3dgs first", "3dgs second", "3dgs"]
    same_name = [make_run("p/run"), make_run("q/run")]
    labels = [label for label, _ in compare(same_name).table.runs]
    assert len(set(labels)) == 2


def test_a_folder_named_twice_counts_once(make_run):
    run = make_run("a")
    assert len(compare([run, run.parent / "." / "a"]).table.runs) == 1
    other = make_run("b", preset="ringlight")
    again = compare([run, other, run]).table
    assert [label for label, _ in again.runs] == ["3dgs", "ringlight"], "its first place counts"
    assert again.baseline == "3dgs"


def test_missing_or_damaged_runs_are_refused(make_run, tmp_path):
    with pytest.raises(RunError, match="no runs to compare"):
        compare([])
    with pytest.raises(RunError, match="no such run folder"):
        compare([tmp_path / "nowhere"])
    (tmp_path / "empty").mkdir()
    with pytest.raises(RunError, match=r"holds no report\.json"):
        compare([make_run("a"), tmp_path / "empty"])
    damaged = make_run("damaged")
    (damaged / RENDERS / picture_name("r_0")).write_bytes(b"\x89PNG")
    with pytest.raises(RunError, match="cannot be read as a picture"):
        compare([damaged])
